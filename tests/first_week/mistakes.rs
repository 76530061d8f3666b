//! What a newcomer gets wrong, and is told.

use crate::home::Home;

#[test]
fn messages_name_the_fix() {
    let home = Home::new();
    let render = |rest: &str| format!("render swm/PushT-v1 --steps 0 --out a.png {rest}");
    home.refused("fovs swm/PushT", &["did you mean `swm/PushT-v1`?"]);
    home.refused(&render("--vary agent.colr"), &["did you mean `agent.color`?"]);
    home.refused(&render("--set agent.color=crimsonish"), &["is no color", "red"]);
    home.refused(&render("--policy expertt"), &["did you mean `expert`?"]);
    let narrow = home.ok(&render("--vary agent.color"));
    assert!(narrow.err.contains("--vary +agent.color"), "{}", narrow.err);
    home.ok(&render("--vary +*.color --set background.color=#203040"));
    for (name, feature) in [("onnx:model", "onnx"), ("mpc:runs/lewm", "baselines")] {
        let said = home.run(&render(&format!("--policy {name}")));
        // A program that has the feature misses the model.
        let is_told =
            said.err.contains(&format!("--features {feature}")) || !said.err.contains("unknown policy");
        assert!(said.status != Some(0) && is_told, "{}", said.err);
    }
}

#[test]
fn what_there_is_fits_on_a_page() {
    let home = Home::new();
    let shown = home.ok("envs swm/PushT-v1").out;
    assert!(shown.lines().count() < 80 && shown.contains("--full"), "{shown}");
    home.ok("fovs swm/PushT-v1");
    home.ok("solvers");
}

#[cfg(feature = "mujoco")]
#[test]
fn tasks_are_found_by_a_search() {
    let home = Home::new();
    assert!(home.ok("envs").out.contains("`swm envs --tasks` lists them"));
    let listed = home.ok("envs --tasks").out;
    let found: Vec<&str> = listed.lines().filter(|line| line.contains("stand")).collect();
    assert!(found.iter().any(|line| line.contains("swm/WalkerDMControl-v0")), "{listed}");
    assert!(found.iter().any(|line| line.contains("swm/HumanoidDMControl-v0")), "{listed}");
    let tasks = home.json("envs --tasks");
    for env in ["swm/CheetahDMControl-v0", "swm/ReacherDMControl-v0", "swm/QuadrupedDMControl-v0"] {
        let of = tasks.as_array().unwrap().iter().filter(|task| task["env"] == env);
        let defaults: Vec<bool> = of.map(|task| task["default"].as_bool().unwrap()).collect();
        assert!(defaults.len() > 1 && defaults[0] && !defaults[1..].contains(&true), "{env}: {defaults:?}");
    }
    assert!(tasks.as_array().unwrap().iter().all(|task| !task["doc"].as_str().unwrap().is_empty()));
    home.refused("envs swm/PushT-v1 --tasks", &["cannot be used with"]);
}

#[test]
fn settings_are_told_with_the_nearest() {
    let home = Home::new();
    let render = |rest: &str| format!("render swm/PushT-v1 --steps 0 --out a.png {rest}");
    let near = |line: &str, word: &str| home.refused(line, &[&format!("did you mean `{word}`?")]);
    near(&render("--policy cem:sample=100"), "samples");
    near(&render("--policy weak:dist_constrain=3"), "dist_constraint");
    near(&render("--env-option rendr=fast"), "render");
    near(&render("--env-option render=fst"), "fast");
    near(&render("--vary *.colors"), "*.color");
    near(
        "manifest make swm/PushT-v1 --tier moderate --image-size 32 --distractor noise:stdd=3 --out a.toml",
        "std",
    );
    // What is a setting elsewhere is no factor, and is offered where it can be set.
    home.refused(
        "render swm/PushTRapier-v0 --steps 0 --out a.png --set friction=0.3",
        &["`friction` is no factor", "--env-option friction=VALUE"],
    );
    let said = home.run(&render("--env-option frict=1"));
    assert!(said.status == Some(2) && !said.err.contains("friction"), "PushT-v1 has none: {}", said.err);
    for (wrong, told) in [
        (
            "--policy cem:samples=many",
            "setting `samples`: must be a whole number, 0 or more; found string \"many\"",
        ),
        ("--env-option relative=3", "setting `relative`: must be true or false; found integer `3`"),
    ] {
        home.refused(&render(wrong), &[told]);
    }
    home.refused(
        &render("--policy cem:seeds=1"),
        &["setting `seeds`: unknown (did you mean `seed`?); known are samples, "],
    );
    home.refused(&render("--policy cem,samples=20"), &["settings follow a colon", "`cem:samples=20`"]);
    for (option, instead) in
        [("--policy-seed 3", "--seed"), ("--oracle cem", "--policy"), ("--reference random", "--policy")]
    {
        home.refused(
            &format!("eval swm/PushT-v1 --policy random --episodes 1 {option}"),
            &[option.split(' ').next().unwrap(), "give --manifest", instead],
        );
    }
    // A name is wrong before anything is reset.
    let said = home.run(&render("--vary agent.colr --set block.scal=3"));
    assert!(said.err.starts_with("error: --vary agent.colr: unknown factor"), "{}", said.err);
    assert!(!home.path("a.png").exists());
}

#[test]
fn names_are_checked_before_files() {
    let home = Home::new();
    home.ok("collect swm/PushT-v1 --episodes 2 --max-steps 3 --image-size none --out a.h5");
    home.ok("eval swm/PushT-v1 --policy random --episodes 1 --budget 2 --videos 0 --out result");
    let collect = "collect swm/PushT-v1 --episodes 2 --out a.h5";
    let eval = "eval swm/PushT-v1 --out result";
    for (line, told) in [
        (format!("{collect} --policy wek"), "did you mean `weak`?"),
        (format!("{collect} --vary agent.colr"), "did you mean `agent.color`?"),
        (format!("{collect} --set agent.colr=red"), "did you mean `agent.color`?"),
        (format!("{collect} --env-option rendr=fast"), "did you mean `render`?"),
        (format!("{collect} --format hdf"), "did you mean `hdf5`?"),
        (collect.to_owned(), "a.h5 exists"),
        (format!("{eval} --policy randon"), "did you mean `random`?"),
        (format!("{eval} --policy random --vary agent.colr"), "did you mean `agent.color`?"),
        (format!("{eval} --policy random"), "--again"),
        ("eval swm/PushT-v1 --policy randon --dataset no.h5".to_owned(), "did you mean `random`?"),
        ("convert no.h5 b.h5 --format hdf".to_owned(), "did you mean `hdf5`?"),
        ("quality swm/PushT-v1 --model tru --dataset no.h5".to_owned(), "--model tru"),
        ("quality swm/PushT-v1 --violation state[2]=x --dataset no.h5".to_owned(), "--violation"),
    ] {
        home.refused(&line, &[told]);
    }
}

#[test]
fn files_that_cannot_be_read_are_told_by_what_is_wrong_in_them() {
    let home = Home::new();
    home.ok("manifest make swm/TwoRoom-v2 --tier moderate --episodes 2 --budget 4 --out good.toml");
    let good = std::fs::read_to_string(home.path("good.toml")).unwrap();
    let text: String =
        good.lines().filter(|line| !line.starts_with("hash")).map(|line| format!("{line}\n")).collect();
    let manifests = [
        ("binary.toml", vec![0xff, 0xfe], "no text in UTF-8"),
        ("cut.toml", b"a = 1\nb = [".to_vec(), "line 2, `b = [`"),
        (
            "misfit.toml",
            text.replace("budget = 4", "budget = \"few\"").into(),
            "`budget`: must be a whole number",
        ),
        ("misspelt.toml", text.replace("budget = 4", "bugdet = 4").into(), "did you mean `budget`?"),
        ("short.toml", text.replace("budget = 4\n", "").into(), "`budget` is missing"),
        ("misfit.json", b"{\"budget\": \"few\"}".to_vec(), "`budget`: must be a whole number"),
    ];
    for (name, content, told) in manifests {
        std::fs::write(home.path(name), content).unwrap();
        home.refused(&format!("manifest show {name}"), &[name, told]);
        home.refused(&format!("eval --manifest {name} --policy random"), &[name, told]);
    }
    home.ok("eval --manifest good.toml --policy random --reference none --out result");
    let receipt = std::fs::read_to_string(home.path("result/receipt.json")).unwrap();
    for (content, told) in [
        (
            receipt.replace("\"successes\": ", "\"successes\": \"x\", \"was\": "),
            "`summary`: must be a whole number",
        ),
        (receipt[..receipt.len() / 2].to_owned(), "it ends in the middle of a value"),
        ("{}".to_owned(), "is no receipt"),
    ] {
        std::fs::write(home.path("result/receipt.json"), content).unwrap();
        home.refused("compare result", &["result/receipt.json", told]);
        home.refused("verify-result result", &["result/receipt.json", told]);
    }
    std::fs::write(home.path("cem.toml"), "samples = \n").unwrap();
    home.refused("render swm/PushT-v1 --policy cem:@cem.toml --out a.png", &["cem.toml", "line 1"]);
}

#[test]
fn copies_name_the_flags_that_they_have() {
    let home = Home::new();
    let collect = "collect swm/TwoRoom-v2 --episodes 2 --max-steps 4";
    home.ok(&format!("{collect} --image-size 24 --out seen.h5"));
    home.ok(&format!("{collect} --image-size none --out blind.h5"));
    home.ok(&format!("{collect} --image-size none --seed 9 --out other.h5"));
    home.refused("convert blind.h5 other.h5", &["other.h5 exists and is another dataset", "--overwrite"]);
    home.ok("convert blind.h5 other.h5 --overwrite");
    let told = ["seen.h5 holds images of 24x24", "blind.h5 holds no images", "--image-size 24x24"];
    home.refused("merge seen.h5 blind.h5 --out both.h5", &told);
    home.ok("merge seen.h5 blind.h5 --image-size 24x24 --out both.h5");
}

#[test]
fn a_dataset_of_another_environment_is_a_wrong_request() {
    let home = Home::new();
    home.ok("collect swm/TwoRoom-v2 --episodes 3 --max-steps 12 --image-size none --out rooms.h5");
    let told = ["rooms.h5", "recorded in swm/TwoRoom-v2, not in swm/PushT-v1"];
    for line in [
        "manifest make swm/PushT-v1 --dataset rooms.h5 --tier historic --episodes 1 --goal-offset 2 --out task.toml",
        "eval swm/PushT-v1 --policy random --dataset rooms.h5 --episodes 1 --goal-offset 2",
        "quality swm/PushT-v1 --dataset rooms.h5",
    ] {
        home.refused(line, &told);
    }
    for share in ["0", "1.5", "nan"] {
        let line =
            "manifest make swm/TwoRoom-v2 --dataset rooms.h5 --tier moderate --episodes 1 --out task.toml";
        home.refused(&format!("{line} --held-out {share}"), &["--held-out", "above 0 and at most 1"]);
    }
    assert!(!home.path("task.toml").exists());
    let skip = "--dataset rooms.h5 --episodes 1 --goal-offset 2 --frame-skip 2";
    for line in [
        format!("manifest make swm/TwoRoom-v2 {skip} --tier historic --out task.toml"),
        format!("eval swm/TwoRoom-v2 --policy random {skip}"),
    ] {
        home.refused(&line, &["--frame-skip 2", "with frame skip 1", "leave out"]);
    }
    home.refused(
        "quality swm/TwoRoom-v2 --dataset rooms.h5 --rows 40 --horizon 20",
        &["--horizon 20", "the longest episode has"],
    );
}

#[test]
fn a_dataset_is_not_read_twice_nor_written_onto_itself() {
    let home = Home::new();
    home.ok("collect swm/TwoRoom-v2 --episodes 2 --max-steps 4 --image-size none --out a.h5");
    home.ok("collect swm/TwoRoom-v2 --episodes 2 --max-steps 4 --image-size none --seed 1 --out b.h5");
    home.ok("convert a.h5 a.folder");
    home.refused("convert a.h5 a.h5", &["a.h5", "give another target"]);
    home.refused("convert a.h5 ./a.h5 --overwrite", &["a.h5", "give another target"]);
    home.refused("convert a.folder a.folder", &["a.folder", "give another target"]);
    home.refused("merge a.h5 b.h5 --out a.h5", &["a.h5", "give another --out"]);
    home.refused("merge a.h5 a.h5 --out x.h5", &["a.h5 is named twice", "name it once"]);
    home.refused("merge b.h5 a.h5 ./a.h5 --out x.h5", &["a.h5 and ./a.h5 are the same dataset"]);
    home.refused("merge a.folder a.folder/ --out x.h5", &["a.folder"]);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(home.path("a.h5"), home.path("link.h5")).expect("a link is made");
        std::fs::hard_link(home.path("a.h5"), home.path("hard.h5")).expect("a link is made");
        home.refused("merge a.h5 link.h5 --out x.h5", &["a.h5 and link.h5 are the same dataset"]);
        home.refused("merge a.h5 hard.h5 --out x.h5 --partial", &["a.h5 and hard.h5 are the same dataset"]);
        home.refused("convert a.h5 link.h5 --overwrite", &["link.h5", "give another target"]);
    }
    assert!(!home.path("x.h5").exists());
    home.ok("merge a.h5 b.h5 --out x.h5");
    assert_eq!(home.json("inspect x.h5")["episodes"], 4);
}
