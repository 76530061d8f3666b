//! Every command, on a small but real task, as a user would run it.

use serde_json::json;
use swm_tests::golden::{GoldenFile, check_file, rules};

use crate::support::{Folder, PUSHT, content, root, swm, swm_fails, swm_json, swm_ok};

fn dataset(folder: &Folder) -> String {
    let out = folder.path("data.h5");
    swm_ok(&[
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        "4",
        "--seed",
        "3",
        "--max-steps",
        "30",
        "--image-size",
        "48x64",
        "--vary",
        "agent.start_position,block,agent.color",
        "--set",
        "background.color=10,20,30",
        "--out",
        &out,
        "--quiet",
    ]);
    out
}

#[test]
fn envs_and_fovs_list_what_scripts_rely_on() {
    let envs = swm_json(&["envs"]);
    let pusht = envs.as_array().unwrap().iter().find(|env| env["id"] == PUSHT).expect("PushT is listed");
    assert_eq!(pusht["num_factors"], 16);
    let fovs = swm_json(&["fovs", PUSHT]);
    assert_eq!(fovs.as_array().unwrap().len(), 16);
    let scale = fovs.as_array().unwrap().iter().find(|fov| fov["name"] == "block.scale").unwrap();
    for (key, value) in [
        ("kind", json!("box")),
        ("shape", json!([])),
        ("low", json!(20.0)),
        ("high", json!(60.0)),
        ("default", json!(30.0)),
    ] {
        assert_eq!(scale[key], value, "{key}");
    }
    assert!(swm_ok(&["envs", PUSHT]).contains("weak"), "the page of an environment lists its policies");
    assert!(swm_ok(&["completions", "bash"]).contains("swm"));
}

#[test]
fn vary_says_what_it_no_longer_samples_and_adds_with_a_plus() {
    let folder = Folder::new();
    let varied = |vary: &str| {
        let out = folder.path(&format!("{vary}.h5"));
        let args = ["collect", PUSHT, "--policy", "weak", "--episodes", "3", "--max-steps", "2"];
        let args = [&args[..], &["--image-size", "none", "--vary", vary, "--out", &out]].concat();
        let output = swm(&args).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{said}");
        let shown = swm_json(&["inspect", &out]);
        let columns = shown["columns"].as_object().unwrap().keys();
        let names = columns.filter_map(|name| name.strip_prefix("variation.")).map(str::to_owned);
        let note = said.lines().find(|line| line.starts_with("note: ")).map(str::to_owned);
        let starts = content(&out)["proprio"];
        (names.collect::<Vec<_>>(), note, starts)
    };
    let fovs = swm_json(&["fovs", PUSHT]);
    let defaults: Vec<&str> = fovs
        .as_array()
        .unwrap()
        .iter()
        .filter(|fov| fov["sampled_by_default"] == true)
        .map(|fov| fov["name"].as_str().unwrap())
        .collect();
    let (names, note, starts) = varied("agent.color");
    let note = note.expect("starts are no longer sampled, which is said");
    assert!(
        defaults.iter().all(|name| note.contains(name)) && note.contains("--vary +agent.color"),
        "{note}"
    );
    assert_eq!(names, ["agent.color"]);
    let (names, note, with_default) = varied("+agent.color");
    assert_eq!(note, None);
    assert!(
        defaults.iter().chain(&["agent.color"]).all(|&name| names.iter().any(|n| n == name)),
        "{names:?}"
    );
    assert_ne!(starts, with_default, "starts are sampled again");
    assert_eq!(varied("default,agent.color").0, names);
    let (names, _, _) = varied("*.color");
    let colors = ["background.color", "goal.color", "block.color", "agent.color"];
    assert_eq!(names, colors);
    let message = swm_fails(2, &["render", PUSHT, "--vary", "*.colour", "--out", &folder.path("a.png")]);
    assert!(message.contains("did you mean `*.color`?"), "{message}");
}

#[test]
fn recordings_that_varied_different_factors_are_joined() {
    let folder = Folder::new();
    let record = |name: &str, extra: &[&str]| {
        let out = folder.path(name);
        let args = ["collect", PUSHT, "--policy", "weak", "--episodes", "2", "--max-steps", "5", "--quiet"];
        let args = [&args[..], &["--replayable", "2", "--out", &out], extra].concat();
        let done = swm(&args).output().unwrap();
        (out, done.status.success(), String::from_utf8(done.stderr).unwrap())
    };
    let (plain, ..) = record("plain.h5", &[]);
    let (angles, ..) = record("angles.h5", &["--seed", "1", "--vary", "+goal.angle,goal.scale"]);
    let both = folder.path("both.h5");
    swm_ok(&["merge", &plain, &angles, "--out", &both, "--quiet"]);
    let mut joined = swm::data::open(both.as_ref()).unwrap();
    let column = joined.schema().require("variation.goal.angle").unwrap();
    let values: Vec<f64> = (0..4)
        .map(|episode| {
            let mut value = [0.0];
            let first = swm::data::Steps { first: 0, count: 1, stride: 1 };
            joined.read_column(column, episode, first, swm::core::SliceMut::F64(&mut value)).unwrap();
            value[0]
        })
        .collect();
    assert_eq!(values[..2], [std::f64::consts::FRAC_PI_4; 2], "the default of the factor");
    assert_ne!(values[2], values[3]);
    assert_eq!(swm_json(&["replay", &both, "--tolerance", "0"])["ok"], true);
    // The goal's size is the block's where nothing asks for another: a filled column does not.
    let images = |file: &str, out: &str| {
        let out = folder.path(out);
        let args =
            ["preview", file, "--episodes", "0", "--column", "goal", "--image-size", "64", "--out", &out];
        swm_ok(&[&args[..], &["--quiet"]].concat());
        std::fs::read(out).unwrap()
    };
    assert_eq!(images(&both, "a.png"), images(&plain, "b.png"));

    // A file with the column takes a run that does not vary it, and the other way round `merge` is named.
    let append = ["--mode", "append", "--seed", "9"];
    let (_, done, said) = record("angles.h5", &append);
    assert!(done, "{said}");
    assert_eq!(swm_json(&["replay", &angles, "--tolerance", "0"])["ok"], true);
    let (_, done, said) = record("plain.h5", &[&append[..], &["--vary", "+goal.angle"]].concat());
    assert!(!done && said.contains("swm merge"), "{said}");
}

#[test]
fn a_crate_with_an_environment_is_made_anywhere() {
    let folder = Folder::new();
    let made = folder.path("my-env");
    let checkout = root();
    let args = ["new-env", "my-env", "--out", &made, "--checkout", checkout.to_str().unwrap()];
    swm_ok(&args);
    let read = |name: &str| std::fs::read_to_string(format!("{made}/{name}")).unwrap();
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    assert_eq!(manifest["package"]["name"].as_str(), Some("my-env"));
    for (name, place) in manifest["patch"]["crates-io"].as_table().unwrap() {
        let at = place["path"].as_str().unwrap();
        assert!(std::path::Path::new(at).join("Cargo.toml").is_file(), "{name}: {at}");
    }
    for file in ["src/lib.rs", "src/main.rs", "tests/conformance.rs", "README.md", ".gitignore"] {
        assert!(!read(file).contains("{{"), "{file}");
    }
    assert!(read("src/main.rs").contains("my_env::POINT"));
    assert!(swm_fails(2, &args).contains("is not empty"));
    assert!(swm_fails(2, &["new-env", "My Env", "--out", &made]).contains("lower-case"));
    let nowhere = ["new-env", "other", "--out", &folder.path("other"), "--checkout", &folder.path("")];
    assert!(swm_fails(2, &nowhere).contains("no checkout"));
    let git = folder.path("by-git");
    swm_ok(&["new-env", "by-git", "--out", &git]);
    let manifest: toml::Table =
        std::fs::read_to_string(format!("{git}/Cargo.toml")).unwrap().parse().unwrap();
    assert!(manifest["patch"]["crates-io"]["swm"]["git"].as_str().unwrap().starts_with("https://"));
}

#[test]
fn an_environment_is_shown_on_a_page() {
    let short = swm_ok(&["envs", PUSHT]);
    let full = swm_ok(&["envs", PUSHT, "--full"]);
    assert!(short.lines().count() < 80 && full.lines().count() > 200, "{}", short.lines().count());
    let at = |text: &str, what: &str| text.find(what).unwrap_or_else(|| panic!("no `{what}` in\n{text}"));
    assert!(at(&short, "--env-option") < at(&short, "--policy"), "settings of the environment come first");
    assert_eq!(short.matches("receding_horizon").count(), 1, "a shared setting stands once");
    assert!(short.contains("--full") && full.matches("receding_horizon").count() > 5);
}

#[test]
fn folders_of_results_are_made_and_counts_are_of_their_number() {
    let folder = Folder::new();
    let out = folder.path("new/folder/a.h5");
    let args =
        ["collect", PUSHT, "--episodes", "1", "--max-steps", "2", "--image-size", "16x16", "--out", &out];
    let output = swm(&args).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !said.contains("written to"), "a short run has no lines: {said}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("wrote 1 episode (3 rows"));
    let sheet = ["preview", &out, "--frames", "1", "--out", &folder.path("more/sheet.png")];
    assert!(swm_ok(&sheet).contains("(1 episode, 1 frame)"));
    let output =
        swm(&[&args[..9], &[&folder.path("b.h5"), "--report-every", "0"]].concat()).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("episode 0 written to"));
    let factors = swm_ok(&["fovs", "swm/TwoRoom-v1"]);
    assert!(!factors.contains("99999"), "{factors}");
}

#[test]
fn colors_are_set_by_code_name_or_range() {
    let folder = Folder::new();
    let start = |name: &str, color: &str| {
        let out = folder.path(name);
        let set = format!("agent.color={color}");
        let args = ["render", PUSHT, "--steps", "0", "--image-size", "64x64", "--set", &set, "--out", &out];
        let output = swm(&args).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{said}");
        (std::fs::read(out).unwrap(), said)
    };
    let (red, said) = start("a.png", "255,0,0");
    assert!(!said.contains("read as"), "{said}");
    assert_eq!(start("b.png", "#ff0000").0, red);
    assert_eq!(start("c.png", "red").0, red);
    let (unit, said) = start("d.png", "1.0,0,0");
    assert!(unit == red && said.contains("read as a color of the range 0–1: 255,0,0"), "{said}");
    let reddish = ["render", PUSHT, "--set", "agent.color=reddish", "--out", &folder.path("e.png")];
    let message = swm_fails(2, &reddish);
    assert!(message.contains("`reddish` is no color") && message.contains("orange"), "{message}");
}

#[test]
fn inspect_shows_columns_and_counts() {
    let folder = Folder::new();
    let shown = swm_json(&["inspect", &dataset(&folder)]);
    assert_eq!((&shown["format"], &shown["episodes"]), (&json!("hdf5"), &json!(4)));
    assert_eq!(shown["steps"], 4 * 31);
    assert_eq!(shown["columns"]["pixels"], json!({"dtype": "uint8", "shape": [48, 64, 3]}));
    assert_eq!(shown["columns"]["action"], json!({"dtype": "float32", "shape": [2]}));
    let columns = shown["columns"].as_object().unwrap();
    for varied in ["agent.start_position", "block.scale", "block.shape", "agent.color", "background.color"] {
        assert!(columns.contains_key(&format!("variation.{varied}")), "{varied} was drawn or set");
    }
    assert!(!columns.contains_key("variation.goal.scale"), "what was neither drawn nor set is left out");
    assert_eq!(shown["metadata"]["env"], PUSHT);
}

#[test]
fn datasets_of_every_kind_replay() {
    let folder = Folder::new();
    let kinds: [(&str, &[&str]); 5] = [
        ("frame skip", &["--policy", "expert", "--frame-skip", "2"]),
        (
            "a default factor at its default",
            &["--policy", "weak", "--vary", "agent", "--set", "block.angle=1"],
        ),
        ("nothing drawn", &["--policy", "weak", "--vary", "none"]),
        ("everything drawn", &["--policy", "weak", "--vary", "all"]),
        ("absolute actions", &["--policy", "weak", "--env-option", "relative=false"]),
    ];
    for (index, (kind, options)) in kinds.into_iter().enumerate() {
        let out = folder.path(&format!("{index}.h5"));
        let collect = [
            "collect",
            PUSHT,
            "--episodes",
            "3",
            "--seed",
            "3",
            "--image-size",
            "none",
            "--out",
            &out,
            "--quiet",
        ];
        swm_ok(&[&collect[..], options].concat());
        assert_eq!(swm_json(&["replay", &out, "--tolerance", "0"])["ok"], true, "{kind}");
    }
}

#[test]
fn evaluation_takes_settings_and_frame_skip_from_the_dataset() {
    let folder = Folder::new();
    let out = folder.path("plus.h5");
    swm_ok(&[
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        "2",
        "--max-steps",
        "20",
        "--image-size",
        "none",
        "--frame-skip",
        "2",
        "--env-option",
        "init_value={\"block.shape\":7}",
        "--out",
        &out,
        "--quiet",
    ]);
    let eval =
        ["eval", PUSHT, "--policy", "random", "--dataset", &out, "--goal-offset", "3", "--budget", "3"];
    let result = swm_json(&[&eval[..], &["--episodes", "2", "--quiet"]].concat());
    assert_eq!(result["setup"]["frame_skip"], 2);
    assert_eq!(result["setup"]["settings"]["init_value"]["block.shape"], 7);
    let message = swm_fails(1, &[&eval[..], &["--episodes", "2", "--frame-skip", "1"]].concat());
    assert!(message.contains("frame skip 2"), "{message}");
}

#[test]
fn an_appended_run_is_told_apart() {
    let folder = Folder::new();
    let out = folder.path("two.h5");
    let base = [
        "collect",
        PUSHT,
        "--max-steps",
        "3",
        "--image-size",
        "none",
        "--episodes",
        "2",
        "--out",
        &out,
        "--quiet",
    ];
    swm_ok(&[&base[..], &["--policy", "weak"]].concat());
    swm_ok(&[&base[..], &["--policy", "random", "--seed", "9", "--mode", "append"]].concat());
    let runs = &swm_json(&["inspect", &out])["runs"];
    assert_eq!(runs[0]["metadata"]["seed"], 0);
    assert_eq!((&runs[1]["first_episode"], &runs[1]["metadata"]["policy"]), (&json!(2), &json!("random")));
}

#[test]
fn columns_can_be_left_out() {
    let folder = Folder::new();
    let out = folder.path("small.h5");
    let collect =
        ["collect", PUSHT, "--episodes", "1", "--max-steps", "3", "--image-size", "16x16", "--out", &out];
    swm_ok(&[&collect[..], &["--without", "goal,n_contacts", "--quiet"]].concat());
    let columns = &swm_json(&["inspect", &out])["columns"];
    assert!(
        columns["pixels"].is_object() && columns["goal"].is_null() && columns["n_contacts"].is_null(),
        "{columns}"
    );
    let message = swm_fails(2, &[&collect[..], &["--mode", "overwrite", "--without", "gaol"]].concat());
    assert!(message.contains("did you mean `goal`?"), "{message}");
}

#[test]
fn a_dataset_replays_exactly() {
    let folder = Folder::new();
    let data = dataset(&folder);
    let report = swm_json(&["replay", &data, "--tolerance", "0"]);
    assert_eq!(report["ok"], true, "{report}");
    for column in ["state", "proprio", "block_pose"] {
        assert_eq!(report["columns"][column]["max_abs"], 0.0, "{column}");
        assert_eq!(report["columns"][column]["final_abs"], 0.0, "{column}");
    }
    assert_eq!(swm_json(&["replay", &data, "--episodes", "1..3"])["episodes"], 2);
    let message = swm_fails(2, &["replay", &data, "--episodes", "9"]);
    assert!(message.contains("holds 4"), "{message}");
}

#[test]
fn evaluation_from_a_dataset_writes_a_report() {
    let folder = Folder::new();
    let (data, out) = (dataset(&folder), folder.path("report"));
    let result = swm_json(&[
        "eval",
        PUSHT,
        "--policy",
        "random",
        "--dataset",
        &data,
        "--goal-offset",
        "5",
        "--budget",
        "8",
        "--episodes",
        "6",
        "--out",
        &out,
        "--videos",
        "2",
        "--video-format",
        "gif",
        "--image-size",
        "32x32",
        "--quiet",
    ]);
    assert_eq!((&result["episodes"], &result["protocol"]["goal_offset"]), (&json!(6), &json!(5)));
    assert_eq!(result["episode_successes"].as_array().unwrap().len(), 6);
    let [low, high] = [0, 1].map(|i| result["ci95"][i].as_f64().unwrap());
    let rate = result["success_rate"].as_f64().unwrap();
    assert!(low <= rate && rate <= high, "{low} {rate} {high}");
    let stored: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(format!("{out}/result.json")).unwrap()).unwrap();
    assert_eq!(stored["episode_successes"], result["episode_successes"]);
    let names: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert!(names.iter().any(|name| name == "episodes.png"), "{names:?}");
    assert_eq!(names.iter().filter(|name| name.ends_with(".gif")).count(), 2, "{names:?}");
}

#[test]
fn the_solver_reads_its_settings_from_a_file() {
    let folder = Folder::new();
    let settings = folder.path("cem.toml");
    std::fs::write(
        &settings,
        "samples = 16\nelites = 4\niterations = 2\nhorizon = 2\nreceding_horizon = 2\n",
    )
    .unwrap();
    let policy = format!("cem:@{settings},iterations=3");
    let result =
        swm_json(&["eval", PUSHT, "--policy", &policy, "--episodes", "1", "--budget", "4", "--quiet"]);
    let described = result["setup"]["policy"].as_str().unwrap();
    assert!(described.contains("samples=16") && described.contains("iterations=3"), "{described}");
}

#[test]
fn render_makes_images_and_videos() {
    let folder = Folder::new();
    for (name, magic) in [("a.png", &b"\x89PNG"[..]), ("a.gif", b"GIF89a")] {
        let out = folder.path(name);
        swm_ok(&[
            "render",
            PUSHT,
            "--seed",
            "1",
            "--steps",
            "3",
            "--image-size",
            "64x64",
            "--out",
            &out,
            "--quiet",
        ]);
        assert!(std::fs::read(&out).unwrap().starts_with(magic), "{name}");
    }
    let out = folder.path("a.mp4");
    let video =
        ["render", PUSHT, "--vary", "all", "--steps", "3", "--image-size", "64x64", "--out", &out, "--quiet"];
    if cfg!(feature = "mp4") {
        swm_ok(&video);
        assert_eq!(&std::fs::read(&out).unwrap()[4..8], b"ftyp");
    } else {
        let message = swm_fails(1, &video);
        assert!(message.contains("mp4"), "{message}");
    }
    let message = swm_fails(2, &["render", PUSHT, "--steps", "1", "--out", &folder.path("a.bmp")]);
    assert!(message.contains("mp4"), "{message}");
}

#[test]
fn bench_measures_every_image_kind() {
    let list = swm_json(&["bench", PUSHT, "--seconds", "0.02", "--quiet"]);
    let list = list.as_array().unwrap();
    assert!(list.iter().any(|m| m["pixels"] == true) && list.iter().any(|m| m["pixels"] == false));
    for measurement in list {
        assert_eq!(measurement["env"], PUSHT);
        assert!(measurement["steps_per_second"].as_f64().unwrap() > 0.0, "{measurement}");
        assert!(
            measurement["threads"].as_u64().unwrap() >= 1 && measurement["num_envs"].as_u64().unwrap() >= 1
        );
    }
}

/// The tests are built without the tensor library; what is said then is tested here, training itself in its crate.
#[test]
fn commands_that_need_baselines_say_how_to_build_them() {
    for call in [
        &["train", "--list"][..],
        &["checkpoints", "runs/lewm"],
        &["eval", PUSHT, "--policy", "mpc:runs/lewm"],
        &["render", PUSHT, "--policy", "gcbc:runs/gcbc", "--out", "a.png"],
    ] {
        let message = swm_fails(2, call);
        assert!(message.contains("--features baselines") && !message.contains("did you mean"), "{message}");
    }
}

#[test]
fn golden_trajectories_replay() {
    let registry = swm::registry();
    for (folder, least) in [("trajectories", 3), ("classic_control", 80)] {
        let mut checked = 0;
        for entry in std::fs::read_dir(root().join("tests/golden").join(folder)).unwrap() {
            for file in GoldenFile::read_all(&entry.unwrap().path()).unwrap() {
                let rules = rules(&file.env_id).expect("only environments that exist are committed");
                let report = check_file(&registry, rules, &file).unwrap();
                assert!(report.passes(), "{}: {report:#?}", file.name);
                checked += 1;
            }
        }
        assert!(checked >= least, "only {checked} golden {folder}");
    }
}
