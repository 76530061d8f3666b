//! Tests of measurements as requests: refusals, and what is noted.

use serde_json::{Value as Json, json};
use swm_core::Registry;
use swm_core::testing::TOY;

use super::Measure;
use crate::evaluation::Quality;
use crate::request::{Fix, Message, Report, Request as _, TaskError};

/// Measures with these settings besides few short episodes.
fn ask(given: Json, report: &mut dyn Report) -> Result<Quality, TaskError> {
    let small = json!({ "env": TOY.id, "episodes": 4, "rows": 8, "horizon": 3, "plans": 4, "violation": [] });
    let (Json::Object(mut asked), Json::Object(given)) = (small, given) else { panic!("they are objects") };
    asked.extend(given);
    let registry = Registry::new().with(swm_data::FORMATS).with(&[TOY]);
    Measure::from_json(&asked).and_then(|asked: Measure| asked.run(&registry, report))
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none.h5");
    let models = "there are true, constant, gain=NUMBER, pixels=CELLS";
    let any = |name: &'static str| Some(Fix::Any(vec![Fix::give("dataset"), Fix::Leave(name)]));
    let table: [(Json, &str, Option<Fix>); 19] = [
        (json!({ "env": "" }), "env: must be given", None),
        (json!({ "probes": [] }), "did you mean `probe`?", None),
        (json!({ "episodes": 0 }), "episodes=0: use 1 or more", None),
        (json!({ "horizon": 0 }), "horizon=0: use 1 or more", None),
        (json!({ "plans": 1 }), "plans=1: use 2 or more", None),
        (json!({ "rows": 3 }), "rows=3: use more than the horizon, which is 3", None),
        (json!({ "threads": 0 }), "threads=0: use 1 to 1024", None),
        (json!({ "model": "best" }), models, None),
        (json!({ "model": "gain=x" }), "model=gain=x: a gain is a finite number", None),
        (json!({ "model": "pixels=0" }), models, None),
        (json!({ "model": "lewm:runs/a" }), "need a build with the feature `baselines`", None),
        (json!({ "model": "pixels=4" }), "it sees images of at least 4x4", Some(Fix::give("image_size"))),
        (json!({ "violation": ["state=3"] }), "violation=state=3: write COLUMN[ELEMENTS]=VALUES", None),
        (json!({ "violation": ["teleprot"] }), "did you mean `teleport`?", None),
        (json!({ "violation": ["state[9]=1"] }), "no element 9; `state` has 1", None),
        (json!({ "probe": ["angle(state"] }), "write COLUMN, COLUMN[0,1] or angle(COLUMN[4])", None),
        (json!({ "probe": ["stat"] }), "probe=stat: unknown column (did you mean `state`?)", None),
        (json!({ "opening": { "flip": "180" } }), "flip: is about a dataset, and none is named", any("flip")),
        (json!({ "dataset": none }), "none.h5", None),
    ];
    for (given, text, fix) in table {
        let error = match ask(given.clone(), &mut ()) {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{given}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        if fix.is_some() {
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
        }
    }
}

#[test]
fn probes_of_few_episodes_that_miss_the_gate_are_noted() {
    let mut notes: Vec<Message> = Vec::new();
    let measured = ask(json!({ "model": "constant", "probe": ["state"] }), &mut notes).unwrap();
    assert_eq!(measured.probes.len(), 1);
    let fails = measured.gate[0].passes;
    assert_eq!(notes.is_empty(), fails, "{notes:?}");
    notes.clear();
    let measured = ask(json!({ "probe": ["none"] }), &mut notes).unwrap();
    assert!(measured.probes.is_empty() && notes.is_empty(), "{notes:?}");
}
