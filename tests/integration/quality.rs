//! `swm quality`: models without control, on rows of the simulator and of datasets.

use serde_json::Value as Json;

use crate::support::{Folder, swm_fails, swm_json, swm_ok};

#[test]
fn models_are_measured_without_control() {
    let measure = |model: &str| {
        let all = ["quality", "swm/TwoRoom-v2", "--model", model, "--episodes", "6", "--rows", "16"];
        swm_json(&[&all[..], &["--horizon", "5", "--plans", "16", "--violation", "teleport"]].concat())
    };
    let (exact, weak, constant) = (measure("true"), measure("gain=0.5"), measure("constant"));
    assert_eq!(exact, measure("true"));
    let error = |found: &Json, step: usize| found["open_loop_error"][step].as_f64().unwrap();
    assert!(error(&exact, 4) < 1e-6, "{exact}");
    assert!(error(&weak, 4) > error(&weak, 0) && error(&constant, 4) > error(&weak, 4), "{weak} {constant}");
    assert_eq!(exact["violations"][0]["accuracy"], 1.0);
    assert!(constant["ranking"]["mean"].is_null(), "{constant}");
    assert!(exact["ranking"]["mean"].as_f64().unwrap() > 0.9, "{exact}");
    let message = swm_fails(2, &["quality", "swm/TwoRoom-v2", "--model", "best"]);
    assert!(message.contains("gain=NUMBER"), "{message}");
}

#[test]
fn the_gate_asks_for_what_decides_and_for_the_order_of_plans() {
    let small = ["--episodes", "6", "--rows", "16", "--horizon", "5", "--plans", "16"];
    let all =
        |env: &'static str, model: &'static str| [&["quality", env, "--model", model][..], &small].concat();
    let gate = |found: &Json| found["gate"].as_array().unwrap().clone();
    let pusht = swm_json(&all("swm/PushT-v1", "true"));
    let names: Vec<Json> = gate(&pusht).iter().map(|check| check["name"].clone()).collect();
    let wanted = [
        "probe R² of state[0,1,2,3]",
        "probe R² of angle(state[4])",
        "rank correlation of model cost and true cost",
    ];
    assert_eq!(names, wanted);
    // Cosine and sine.
    assert_eq!(pusht["probes"][1]["network"]["r2"].as_array().unwrap().len(), 2);

    let (exact, constant) =
        (swm_json(&all("swm/TwoRoom-v2", "true")), swm_json(&all("swm/TwoRoom-v2", "constant")));
    assert!(gate(&exact).iter().all(|check| check["passes"] == true), "{exact}");
    let order = &gate(&constant)[1];
    assert!(
        order["passes"] == false && order["found"].is_null(),
        "a constant cost orders nothing: {constant}"
    );
    let error = |found: &Json| found["open_loop_unexplained"][4].as_f64().unwrap();
    assert!(error(&exact) < 1e-6 && error(&constant) > 0.1, "{exact} {constant}");
    let text = swm_ok(&all("swm/TwoRoom-v2", "constant"));
    assert!(text.contains("1 of 2 requirements of the gate are met"), "{text}");
    let head = |first: &str| text.lines().find(|line| line.starts_with(first)).unwrap_or_default();
    assert!(head("measure").ends_with("gate"), "{text}");
    assert!(head("steps ahead").ends_with("of the variance"), "shares have a column of their own: {text}");

    let probe = |what: &'static str| [&all("swm/PushT-v1", "true")[..], &["--probe", what]].concat();
    let message = swm_fails(2, &probe("angle(state"));
    assert!(message.contains("write COLUMN, COLUMN[0,1] or angle(COLUMN[4])"), "{message}");
    assert!(swm_fails(2, &probe("state[9]")).contains("`state[9]`: no element 9"));
    let message = swm_fails(2, &probe("stat"));
    assert!(message.contains("--probe stat: unknown column (did you mean `state`?)"), "{message}");
    let message = swm_fails(2, &[&all("swm/PushT-v1", "true")[..], &["--violation", "teleprot"]].concat());
    for (violation, reason) in [
        ("state[9]=1", "no element 9; `state` has 7"),
        ("state[2,3]=1", "1 value(s) for 2 element(s)"),
        ("action[0]=1", "cannot start from that column, but from `state`"),
    ] {
        let refused = swm_fails(2, &[&all("swm/PushT-v1", "true")[..], &["--violation", violation]].concat());
        assert!(refused.contains(reason), "{refused}");
    }
    assert!(message.contains("did you mean `teleport`?") && message.contains("swm fovs"), "{message}");
}

#[test]
fn probes_tell_the_state_from_latents_of_recorded_rows() {
    let folder = Folder::new();
    let data = folder.path("two-room.h5");
    let collect = ["collect", "swm/TwoRoom-v2", "--policy", "expert", "--episodes", "15", "--out", &data];
    swm_ok(&[&collect[..], &["--image-size", "32", "--max-steps", "20", "--quiet"]].concat());
    let measure = |model: &str| {
        let all = ["quality", "swm/TwoRoom-v2", "--dataset", &data, "--model", model, "--probe", "state"];
        swm_json(
            &[&all[..], &["--plans", "2", "--episodes", "15", "--rows", "20", "--horizon", "2"]].concat(),
        )
    };
    let unexplained = |found: &Json, probe: &str| found["probes"][0][probe]["unexplained"].as_f64().unwrap();
    // The state lies open in the state; a line finds it.
    let exact = measure("true");
    // Without the feature `faer` there is no linear probe.
    let probes: &[&str] =
        if exact["probes"][0]["linear"].is_null() { &["network"] } else { &["linear", "network"] };
    assert!(probes.iter().all(|probe| unexplained(&exact, probe) < 1e-2), "{exact}");
    assert_eq!(exact, measure("true"));
    let images = measure("pixels=4");
    for probe in probes {
        let correlation = images["probes"][0][*probe]["correlation"][0].as_f64();
        assert!(correlation > Some(0.5), "{probe}: {images}");
    }
    // The images of a recording without them are rendered.
    let blind = folder.path("blind.h5");
    swm_ok(
        &[&collect[..collect.len() - 1], &[&blind, "--replayable", "--max-steps", "20", "--quiet"]].concat(),
    );
    let rendered =
        ["quality", "swm/TwoRoom-v2", "--dataset", &blind, "--model", "pixels=4", "--probe", "state"];
    let small = ["--image-size", "32", "--plans", "2", "--episodes", "15", "--rows", "20", "--horizon", "2"];
    assert_eq!(swm_json(&[&rendered[..], &small].concat()), images);
    let message = swm_fails(2, &["quality", "swm/TwoRoom-v2", "--model", "pixels=8"]);
    assert!(message.contains("--image-size"), "{message}");
    let message = swm_fails(2, &["quality", "swm/PushT-v1", "--dataset", &data]);
    assert!(message.contains("recorded in swm/TwoRoom-v2"), "{message}");
}
