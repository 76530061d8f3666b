//! `swm plan` and `swm solvers`: what they show, what they write, what they refuse.

use serde_json::Value as Json;

use crate::support::{Folder, PUSHT, swm_fails, swm_json, swm_ok};

/// A planner that is done soon: 2 plans of 2 blocks of 4 actions in 8 steps.
const QUICK: &str = "cem:samples=20,elites=5,iterations=4,horizon=2,receding_horizon=1,action_block=4";

fn plan<'a>(out: &'a str, extra: &[&'a str]) -> Vec<&'a str> {
    let base =
        ["plan", PUSHT, "--policy", QUICK, "--budget", "8", "--image-size", "48", "--video-format", "gif"];
    [&base[..], &["--trace", out, "--quiet"], extra].concat()
}

fn lines(out: &str) -> Vec<Json> {
    let text = std::fs::read_to_string(format!("{out}/trace.jsonl")).expect("the trace is there");
    text.lines().map(|line| serde_json::from_str(line).expect("every line is JSON")).collect()
}

#[test]
fn a_planner_at_work_is_shown() {
    let folder = Folder::new();
    let out = folder.path("out");
    let result = swm_json(&plan(&out, &["--episodes", "2", "--details", "elites"]));
    let plans = result["plans"].as_array().unwrap();
    let key = |plan: &Json| ["episode", "plan", "step"].map(|name| plan[name].as_u64().unwrap());
    assert_eq!(plans.iter().map(key).collect::<Vec<_>>(), [[0, 0, 0], [0, 1, 4], [1, 0, 0], [1, 1, 4]]);
    assert_eq!(result["episodes"].as_array().unwrap().len(), 2);
    assert_eq!(result["episodes"][0]["steps"], 8);

    let lines = lines(&out);
    let count = |kind: &str| lines.iter().filter(|line| line["record"] == kind).count();
    assert_eq!((count("begin"), count("iteration"), count("plan")), (4, 16, 4));
    for (line, shown) in lines.iter().filter(|line| line["record"] == "plan").zip(plans) {
        assert_eq!(line["cost"], shown["cost"]);
        assert_eq!(line["actions"].as_array().unwrap().len(), 2 * 4 * 2);
    }
    let first = lines.iter().find(|line| line["record"] == "iteration").unwrap();
    assert_eq!(first["best"], plans[0]["first_best"]);
    assert_eq!(first["elites"].as_array().unwrap().len(), 5);

    let mut names: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let figures = |kind: &str| names.iter().filter(|name| name.ends_with(kind)).count();
    assert_eq!((figures("_elites.svg"), figures("_paths.svg"), figures(".gif")), (4, 4, 2), "{names:?}");
    let page = std::fs::read_to_string(format!("{out}/index.html")).unwrap();
    let videos = names.iter().filter(|name| name.ends_with(".gif"));
    assert!(videos.clone().all(|video| page.contains(&format!("src=\"{video}\""))), "{names:?}");
    assert_eq!(page.matches("<svg ").count(), 9, "costs, and two figures per plan");
    assert_eq!(page.matches("alt=\"goal of episode").count(), 2, "the goal stands beside each video");
    for name in names.iter().filter(|name| name.ends_with(".svg")) {
        let figure = std::fs::read_to_string(format!("{out}/{name}")).unwrap();
        assert!(figure.starts_with("<svg xmlns=") && figure.ends_with("</svg>\n"), "{name}");
        assert!(!figure.contains("NaN") && !figure.contains("inf "), "{name}");
        assert_eq!(figure.matches("<text").count(), figure.matches("</text>").count(), "{name}");
    }
    let stored: Json =
        serde_json::from_str(&std::fs::read_to_string(format!("{out}/result.json")).unwrap()).unwrap();
    assert_eq!(stored["plans"], result["plans"]);
}

#[test]
fn watching_changes_nothing_and_threads_leave_no_mark() {
    let folder = Folder::new();
    let (a, b) = (folder.path("a"), folder.path("b"));
    let read = |out: &str| std::fs::read(format!("{out}/trace.jsonl")).unwrap();
    let mut watched = swm_json(&plan(&a, &["--threads", "1", "--details", "candidates"]));
    swm_json(&plan(&b, &["--threads", "2", "--details", "candidates"]));
    assert!(read(&a) == read(&b), "the traces differ");
    let mut alone = swm_json(&["plan", PUSHT, "--policy", QUICK, "--budget", "8", "--quiet"]);
    for result in [&mut watched, &mut alone] {
        result["wall_time_s"].take();
        result["plans"].as_array_mut().unwrap().iter_mut().for_each(|plan| drop(plan["wall_time_s"].take()));
    }
    assert_eq!(watched, alone);
}

#[test]
fn a_first_plan_can_be_looked_at_alone() {
    let text = swm_ok(&["plan", PUSHT, "--policy", QUICK, "--plan-only", "--quiet"]);
    for part in [PUSHT, "samples=20", "cost of plan", "1 plan, "] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
}

#[test]
fn a_pair_of_a_manifest_is_planned_as_it_is_evaluated() {
    let folder = Folder::new();
    let [task, out, again] = ["task.toml", "out", "again"].map(|name| folder.path(name));
    let made =
        ["manifest", "make", "swm/TwoRoom-v2", "--episodes", "3", "--tier", "moderate", "--budget", "30"];
    swm_ok(&[&made[..], &["--vary", "+agent.color", "--out", &task]].concat());
    let evaluate = ["eval", "--manifest", &task, "--policy", QUICK, "--reference", "none"];
    let receipt = swm_json(&evaluate);
    for pair in 0..3 {
        let index = pair.to_string();
        let of_pair = ["plan", "--manifest", &task, "--pair", &index, "--policy", QUICK, "--quiet"];
        let planned = swm_json(&of_pair);
        let (episode, evaluated) = (&planned["episodes"][0], &receipt["episodes"][pair]);
        assert_eq!(episode["episode"], pair);
        assert_eq!((&episode["steps"], &episode["success"]), (&evaluated["steps"], &evaluated["success"]));
        // Images, which the task has none of, change no plan.
        let traced = swm_json(&[&of_pair[..], &["--trace", &out, "--overwrite"]].concat());
        assert_eq!(traced["plans"][0]["cost"], planned["plans"][0]["cost"]);
        let video = std::fs::read_dir(&out).unwrap().filter_map(Result::ok);
        assert!(video.map(|file| file.file_name()).any(|name| name.to_string_lossy().contains(&index)));
    }
    let first = swm_json(&["plan", "--manifest", &task, "--policy", QUICK, "--plan-only", "--quiet"]);
    assert_eq!(first["plans"].as_array().unwrap().len(), 1);

    let refused = |args: &[&str], reason: &str| {
        let message = swm_fails(2, &[&["plan", "--policy", QUICK, "--trace", &again], args].concat());
        assert!(message.contains(reason), "{message}");
    };
    refused(&["--manifest", &task, "--pair", "3"], "holds 3 pairs, counted from 0; use 0 to 2");
    refused(&["swm/TwoRoom-v2", "--pair", "1"], "--pair 1: is a pair of a manifest; give --manifest");
    refused(&["--manifest", &task, "--seed", "1"], "a manifest fixes");
    refused(&["--manifest", &task, "--image-size", "64"], "a manifest fixes");
    refused(&[], "nothing names the environment");
    assert!(!std::path::Path::new(&again).exists());
}

#[test]
fn solvers_are_listed_with_their_settings() {
    let all = swm_json(&["solvers"]);
    for solver in all.as_array().unwrap() {
        let name = solver["name"].as_str().unwrap();
        assert_eq!(swm_json(&["solvers", name]), *solver);
        assert!(!solver["settings"].as_array().unwrap().is_empty());
        let page = swm_ok(&["solvers", name]);
        assert!(page.contains("receding_horizon"), "{page}");
        assert_eq!(page.contains("success_bonus"), solver["plans_on_simulator"] == true, "{page}");
    }
    let message = swm_fails(2, &["solvers", "cme"]);
    assert!(message.contains("did you mean `cem`?"), "{message}");
}

#[test]
fn wrong_requests_are_refused_before_anything_is_made() {
    let folder = Folder::new();
    let out = folder.path("out");
    let says = |args: &[&str], words: &[&str]| {
        let message = swm_fails(2, args);
        for word in words {
            assert!(message.contains(word), "swm {args:?}: no `{word}` in\n{message}");
        }
        assert!(!std::path::Path::new(&out).exists(), "a refused request leaves no folder");
    };
    let with = |policy: &'static str| ["plan", PUSHT, "--policy", policy, "--trace", &out];
    says(&with("cme"), &["unknown solver `cme`", "did you mean `cem`?", "swm solvers"]);
    says(&with("ilqr"), &["`ilqr` cannot plan on the true simulator", "cem"]);
    says(&with("weak"), &["`weak` makes no plans", "cem"]);
    says(&with("cem:samples=5,elites=9"), &["elites", "9 of 5 samples"]);
    says(&with("cem:horizon=2"), &["5 blocks of a plan of 2"]);
    says(&with("cem:report=loud"), &["report", "`off`, `plan`, `timed`"]);
    says(&["plan", "swm/PushTT-v1", "--policy", "cem", "--trace", &out], &["did you mean `swm/PushT-v1`?"]);
    says(&plan(&out, &["--episodes", "0"]), &["--episodes 0", "nothing is planned for"]);
    says(&plan(&out, &["--frame-skip", "0"]), &["frame_skip"]);
    says(&plan(&out, &["--vary", "blok"]), &["`blok`"]);
    says(&["plan", PUSHT, "--policy", "cem", "--overwrite"], &["--trace"]);
    let file = folder.path("file");
    std::fs::write(&file, "").unwrap();
    says(&["plan", PUSHT, "--policy", QUICK, "--trace", &file], &["cannot write to the folder", "file"]);
    says(&["plan", PUSHT, "--policy", QUICK, "--trace", "/proc/nowhere"], &["cannot write to the folder"]);
}

#[test]
fn only_an_earlier_trace_is_replaced() {
    let folder = Folder::new();
    let out = folder.path("out");
    swm_ok(&plan(&out, &["--episodes", "2"]));
    let message = swm_fails(2, &plan(&out, &[]));
    assert!(message.contains("not empty") && message.contains("--overwrite"), "{message}");
    let note = format!("{out}/note.txt");
    std::fs::write(&note, "mine").unwrap();
    swm_ok(&plan(&out, &["--overwrite"]));
    let count = lines(&out).iter().filter(|line| line["record"] == "begin").count();
    assert_eq!(count, 2, "one episode of two plans");
    assert!(
        !std::fs::read_dir(&out)
            .unwrap()
            .any(|entry| { entry.unwrap().file_name().to_string_lossy().starts_with("episode_001") })
    );
    assert_eq!(std::fs::read_to_string(&note).unwrap(), "mine");

    let foreign = folder.path("foreign");
    std::fs::create_dir(&foreign).unwrap();
    std::fs::write(format!("{foreign}/index.html"), "mine").unwrap();
    let message = swm_fails(2, &plan(&foreign, &["--overwrite"]));
    assert!(message.contains("no earlier trace"), "{message}");
    assert_eq!(std::fs::read_to_string(format!("{foreign}/index.html")).unwrap(), "mine");
}

#[test]
fn a_planner_on_the_true_dynamics_solves_rooms_and_mazes() {
    let policy = "cem:samples=64,elites=8,iterations=5,horizon=5,receding_horizon=2,action_block=5";
    for env in ["swm/TwoRoom-v1", "swm/TwoRoom-v2", "swm/PointMaze-v0"] {
        let eval = ["eval", env, "--episodes", "5", "--budget", "200", "--quiet"];
        let rate = |policy| swm_json(&[&eval[..], &["--policy", policy]].concat())["success_rate"].clone();
        assert_eq!(rate(policy), 100.0, "{env}");
        assert!(rate("random").as_f64() < Some(60.0), "{env} needs no planner");
    }
}

#[test]
fn the_planner_of_the_rocket_lands_it() {
    let id = "swm/PFRocketLanding-v0";
    let planner = swm::registry().env(id).unwrap().planner.expect("its entry names one");
    let eval = ["eval", id, "--episodes", "3", "--budget", "1200", "--quiet"];
    let rate = |policy| swm_json(&[&eval[..], &["--policy", policy]].concat())["success_rate"].clone();
    assert_eq!(rate(planner), 100.0);
    assert_eq!(rate("random"), 0.0);
}

#[test]
fn the_planners_of_small_tasks_reach_their_goals() {
    for (id, budget) in [
        ("swm/FetchReach-v3", "15"),
        ("swm/MetaWorldReach-v0", "60"),
        ("swm/Piecewise-v0", "100"),
        ("swm/SimplePointMaze-v0", "100"),
        ("swm/SimpleNavigation-v0", "40"),
        ("swm/TablePush3D-v0", "150"),
    ] {
        let planner = swm::registry().env(id).unwrap().planner.expect("its entry names one");
        let eval = ["eval", id, "--episodes", "3", "--budget", budget, "--quiet"];
        let rate = |policy| swm_json(&[&eval[..], &["--policy", policy]].concat())["success_rate"].clone();
        assert_eq!(rate(planner), 100.0, "{id}");
        assert!(rate("random").as_f64() < Some(60.0), "{id} needs no planner");
    }
}

#[test]
fn the_planners_of_classic_control_solve_it() {
    for id in [
        "swm/CartPoleControl-v1",
        "swm/MountainCarControl-v0",
        "swm/MountainCarContinuousControl-v0",
        "swm/AcrobotControl-v1",
        "swm/PendulumControl-v1",
    ] {
        let planner = swm::registry().env(id).unwrap().planner.expect("its entry names one");
        let eval = ["eval", id, "--episodes", "3", "--budget", "500", "--quiet"];
        let rate = |policy| swm_json(&[&eval[..], &["--policy", policy]].concat())["success_rate"].clone();
        assert_eq!(rate(planner), 100.0, "{id}");
        assert!(rate("random").as_f64() < Some(60.0), "{id} needs no planner");
    }
}
