//! What a newcomer meets in the first hours: factors, colors, datasets to be joined, a crate of one's own.

use crate::support::{Folder, PUSHT, content, record, root, swm, swm_fails, swm_json, swm_ok};

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
    let message = swm_fails(2, &["render", PUSHT, "--vary", "*.colr", "--out", &folder.path("a.png")]);
    assert!(message.contains("did you mean `*.color`?"), "{message}");
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
    assert!(swm_fails(2, &["new-env", "match", "--out", &made]).contains("`match` is a word of Rust"));
    assert!(swm_fails(2, &["new-env", "serde", "--out", &made]).contains("the name of another crate"));
    let nowhere = ["new-env", "other", "--out", &folder.path("other"), "--checkout", &folder.path("")];
    assert!(swm_fails(2, &nowhere).contains("no checkout"));
    let git = folder.path("by-git");
    swm_ok(&["new-env", "by-git", "--out", &git]);
    let manifest: toml::Table =
        std::fs::read_to_string(format!("{git}/Cargo.toml")).unwrap().parse().unwrap();
    assert!(manifest["patch"]["crates-io"]["swm"]["git"].as_str().unwrap().starts_with("https://"));
}

/// Cargo joins the manifests and configurations of the folders around, of which the checkout has its own.
#[test]
fn a_crate_is_made_in_the_checkout_too() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let made = folder.path().join("my-env");
    let checkout = root();
    let args =
        ["new-env", "my-env", "--out", made.to_str().unwrap(), "--checkout", checkout.to_str().unwrap()];
    swm_ok(&args);
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut metadata = std::process::Command::new(cargo);
    metadata.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(&made);
    let output = metadata.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["packages"][0]["name"], "my-env");
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
    // What would refuse to act is not on offer.
    let grid = swm_json(&["envs", "swm/SimpleNavigation-v0"]);
    let offered: Vec<&str> =
        grid["policies"].as_array().unwrap().iter().filter_map(|policy| policy["name"].as_str()).collect();
    assert!(offered.contains(&"expert") && offered.contains(&"random"), "{offered:?}");
    assert!(offered.contains(&"categorical-cem"), "{offered:?}");
    assert!(!offered.contains(&"cem") && !offered.contains(&"ou"), "{offered:?}");
}

#[test]
fn statistics_are_shown_of_quantities_and_kept_of_all_columns() {
    let folder = Folder::new();
    let file = record(&folder, "a.h5", "--policy weak --episodes 2 --max-steps 4 --image-size none");
    let listed = |text: &str, column: &str| text.lines().any(|line| line.split(' ').next() == Some(column));
    let shown = swm_ok(&["stats", &file]);
    assert!(
        listed(&shown, "reward") && shown.contains("not listed, as they hold no quantities: "),
        "{shown}"
    );
    for name in ["ep_idx", "step_idx", "seed"] {
        assert!(!listed(&shown, name), "{name} in\n{shown}");
        assert!(listed(&swm_ok(&["stats", &file, "--columns", name]), name), "{name}");
        assert!(swm_json(&["stats", &file])["columns"][name]["mean"].is_array(), "{name}");
    }
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
    assert!(swm_ok(&sheet).contains("(1 episode, 1 frame each)"));
    let output =
        swm(&[&args[..9], &[&folder.path("b.h5"), "--report-every", "0"]].concat()).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("episode 0 written to"));
    let factors = swm_ok(&["fovs", "swm/TwoRoom-v1"]);
    assert!(!factors.contains("99999"), "{factors}");
}

#[test]
fn a_manifest_shows_what_it_changes_and_warns_where_nothing_can_succeed() {
    let folder = Folder::new();
    let (task, run) = (folder.path("task.toml"), folder.path("run.toml"));
    let make = |env: &str, more: &[&str], out: &str| {
        let base = ["manifest", "make", env, "--tier", "historic", "--episodes", "2", "--out", out];
        let output = swm(&[&base[..], more].concat()).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let noted = make(
        PUSHT,
        &["--set", "background.color=black", "--vary", "agent.color", "--env-option", "render=fast"],
        &task,
    );
    assert!(!noted.contains("success test"), "{noted}");
    let shown = swm_ok(&["manifest", "show", &task]);
    for (row, what) in [
        ("settings", "render=\"fast\""),
        ("set", "background.color=[0.0,0.0,0.0]"),
        ("sampled", "agent.color"),
    ] {
        let found = shown.lines().any(|line| line.starts_with(row) && line.contains(what));
        assert!(found, "no {row} {what} in\n{shown}");
    }
    let noted = make("swm/CheetahDMControl-v0", &[], &run);
    assert!(noted.contains("rewards and no success test"), "{noted}");
}

#[test]
fn wrong_requests_are_told_what_is_wrong_and_what_to_do() {
    let folder = Folder::new();
    let [data, blind, other] = ["a.h5", "b.h5", "c.h5"].map(|name| folder.path(name));
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "3", "--max-steps", "30", "--quiet"];
    swm_ok(&[&collect[..], &["--image-size", "none", "--out", &data]].concat());
    swm_ok(&[&collect[..], &["--image-size", "none", "--without", "action", "--out", &blind]].concat());
    let append = [&collect[..], &["--image-size", "32", "--mode", "append", "--out", &data]].concat();
    let make = ["manifest", "make", PUSHT, "--tier", "historic", "--episodes", "1", "--dataset", &data];
    let at_start = [&make[..], &["--goal-offset", "0", "--out", &other]].concat();
    let vary = |names| [&collect[..], &["--out", &other, "--vary", names]].concat();
    for (status, args, told) in [
        (1, &append[..], "with no images, what is added with images of 32x32; record it with no images, too"),
        (2, &at_start, "`goal_offset`: every start would be its goal; use 1 or more"),
        (2, &vary(""), "it names no factor; give --vary none to sample none"),
        (2, &vary("+"), "name a factor behind `+`, such as +agent.color"),
        (2, &vary("agent.color block.color"), "separate several with commas"),
        (1, &["replay", &blind], "b.h5 was recorded without the column `action`, which a replay repeats"),
        (
            2,
            &["stats", &data, "--columns", "actoin"],
            "has no column `actoin` (did you mean `action`?); it has ",
        ),
        (2, &["plan", PUSHT, "--dataset", &data], "`swm manifest make --dataset`"),
    ] {
        let message = swm_fails(status, args);
        assert!(message.contains(told), "{args:?}: {message}");
    }
}
