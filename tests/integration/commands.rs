//! Every command, on a small but real task, as a user would run it.

use serde_json::json;
use swm_tests::golden::{GoldenFile, check_file, rules};

use crate::support::{Folder, PUSHT, collecting, record, root, swm_fails, swm_json, swm_ok};

fn dataset(folder: &Folder) -> String {
    let size = "--policy weak --episodes 4 --seed 3 --max-steps 30 --image-size 48x64";
    let factors = "--vary agent.start_position,block,agent.color --set background.color=10,20,30";
    record(folder, "data.h5", &format!("{size} {factors}"))
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
    let kinds = [
        ("frame skip", "--policy expert --frame-skip 2"),
        ("a default factor at its default", "--policy weak --vary agent --set block.angle=1"),
        ("nothing drawn", "--policy weak --vary none"),
        ("everything drawn", "--policy weak --vary all"),
        ("absolute actions", "--policy weak --env-option relative=false"),
    ];
    for (index, (kind, how)) in kinds.into_iter().enumerate() {
        let how = format!("{how} --episodes 3 --seed 3 --image-size none");
        let out = record(&folder, &format!("{index}.h5"), &how);
        assert_eq!(swm_json(&["replay", &out, "--tolerance", "0"])["ok"], true, "{kind}");
    }
}

#[test]
fn evaluation_takes_settings_and_frame_skip_from_the_dataset() {
    let folder = Folder::new();
    let size = "--policy weak --episodes 2 --max-steps 20 --image-size none --frame-skip 2";
    let out = record(&folder, "plus.h5", &format!("{size} --env-option init_value={{\"block.shape\":7}}"));
    let eval =
        ["eval", PUSHT, "--policy", "random", "--dataset", &out, "--goal-offset", "3", "--budget", "3"];
    let result = swm_json(&[&eval[..], &["--episodes", "2", "--quiet"]].concat());
    assert_eq!(result["setup"]["frame_skip"], 2);
    assert_eq!(result["setup"]["settings"]["init_value"]["block.shape"], 7);
    let message = swm_fails(2, &[&eval[..], &["--episodes", "2", "--frame-skip", "1"]].concat());
    assert!(message.contains("frame skip 2"), "{message}");
}

#[test]
fn an_appended_run_is_told_apart() {
    let folder = Folder::new();
    let size = "--max-steps 3 --image-size none --episodes 2";
    let out = record(&folder, "two.h5", &format!("{size} --policy weak"));
    record(&folder, "two.h5", &format!("{size} --policy random --seed 9 --mode append"));
    let runs = &swm_json(&["inspect", &out])["runs"];
    assert_eq!(runs[0]["metadata"]["seed"], 0);
    assert_eq!((&runs[1]["first_episode"], &runs[1]["metadata"]["policy"]), (&json!(2), &json!("random")));
}

#[test]
fn what_to_do_about_a_dataset_depends_on_what_it_holds() {
    let folder = Folder::new();
    let size = "--max-steps 2 --image-size none";
    let out = record(&folder, "five.h5", &format!("{size} --episodes 5"));
    let told = |how: &str| swm_fails(2, &collecting(&out, &format!("{size} {how}")));
    let message = told("--episodes 2");
    assert!(
        message.contains("five.h5 exists and holds 5 episodes; give --mode append to record 2 more, or"),
        "{message}"
    );
    assert!(message.contains("--mode append and --total 7 in place of --episodes"), "{message}");
    swm_ok(&collecting(&out, &format!("{size} --mode append --total 7")));
    let message = told("--episodes 10");
    assert!(
        message.contains("7 episodes; give --mode append and --total 10 in place of --episodes to complete"),
        "{message}"
    );
    let message = told("--total 3");
    assert!(
        message.contains("7 episodes; give --mode append and --total 10 to record 3 more, or"),
        "{message}"
    );
    assert!(told("--total 30").contains("holds 7 episodes; give --mode append to complete it, or --mode"));
    let letter = folder.path("letter.h5");
    std::fs::write(&letter, "dear").unwrap();
    let message = swm_fails(2, &collecting(&letter, &format!("{size} --episodes 2")));
    assert!(message.contains("letter.h5 exists, and no episode can be added to it ("), "{message}");
    assert!(message.contains("; give another --out"), "{message}");
}

#[test]
fn columns_can_be_left_out() {
    let folder = Folder::new();
    let size = "--episodes 1 --max-steps 3 --image-size 16x16";
    let out = record(&folder, "small.h5", &format!("{size} --without goal,n_contacts"));
    let columns = &swm_json(&["inspect", &out])["columns"];
    assert!(
        columns["pixels"].is_object() && columns["goal"].is_null() && columns["n_contacts"].is_null(),
        "{columns}"
    );
    let message = swm_fails(2, &collecting(&out, &format!("{size} --mode overwrite --without gaol")));
    assert!(message.contains("did you mean `goal`?"), "{message}");
}

#[test]
fn a_dataset_of_integers_replays_exactly() {
    let folder = Folder::new();
    let data = folder.path("grid.h5");
    let collect = ["collect", "swm/SimpleNavigation-v0", "--policy", "expert", "--episodes", "2", "--quiet"];
    swm_ok(&[&collect[..], &["--image-size", "16x16", "--out", &data]].concat());
    let report = swm_json(&["replay", &data, "--tolerance", "0"]);
    assert_eq!(report["ok"], true, "{report}");
    assert_eq!(report["columns"]["state"]["max_abs"], 0.0, "{report}");
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

#[test]
fn golden_trajectories_replay() {
    let registry = swm::registry();
    for (folder, least) in [
        ("trajectories", 3),
        ("classic_control", 80),
        ("fetch", 11),
        ("piecewise", 4),
        ("simple", 18),
        ("mazes", 5),
    ] {
        let mut checked = 0;
        for entry in std::fs::read_dir(root().join("tests/golden").join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "npz") {
                continue;
            }
            for file in GoldenFile::read_all(&path).unwrap() {
                let rules = rules(&file.env_id).expect("only environments that exist are committed");
                let report = check_file(&registry, rules, &file).unwrap();
                assert!(report.passes(), "{}: {report:#?}", file.name);
                checked += 1;
            }
        }
        assert!(checked >= least, "only {checked} golden {folder}");
    }
}
