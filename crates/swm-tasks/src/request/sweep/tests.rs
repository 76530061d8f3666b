//! Tests of sweeps as requests: refusals, results that are there already, and parts.

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::Registry;
use swm_core::testing::TOY;

use super::{Sweep, Swept};
use crate::evaluation;
use crate::request::{Fix, MakeManifest, Message, Report, Request as _, TaskError};

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(&[TOY])
}

fn manifest(path: &Path) {
    let (env, out) = (TOY.id.to_owned(), path.to_owned());
    let request = MakeManifest { env, out, episodes: 3, budget: Some(5), ..MakeManifest::default() };
    request.run(&registry(), &mut ()).unwrap();
}

/// Runs the sweep of `task` with these settings besides.
fn ask(task: &Path, given: Json, report: &mut dyn Report) -> Result<Swept, TaskError> {
    let mut asked = Map::from_iter([
        ("manifest".to_owned(), json!(task)),
        ("policy".to_owned(), "random".into()),
        ("factors".to_owned(), json!([FACTOR])),
    ]);
    let Json::Object(given) = given else { panic!("{given} is no object") };
    asked.extend(given);
    Sweep::from_json(&asked).and_then(|asked| asked.run(&registry(), report))
}

/// A factor of the toy environment.
const FACTOR: &str = "point.gain";

fn sweep(task: &Path, given: Json, report: &mut dyn Report) -> evaluation::Sweep {
    match ask(task, given, report) {
        Ok(Swept::Sweep(sweep)) => *sweep,
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let any = |fixes: &[Fix]| Some(Fix::Any(fixes.to_vec()));
    let table = [
        (json!({ "manifest": null }), "manifest: must be given", None),
        (json!({ "policy": "" }), "policy: must be given", None),
        (json!({ "factor": ["all"] }), "did you mean `factors`?", None),
        (
            json!({ "values": "some" }),
            "values=some: no way to choose values",
            Some(Fix::Choose(["sampled", "extremes", "grid"].map(str::to_owned).to_vec())),
        ),
        (
            json!({ "points": 3 }),
            "points=3: is about a grid",
            any(&[Fix::set("values", "grid"), Fix::Leave("points")]),
        ),
        (json!({ "values": "grid", "points": 1 }), "points=1: a grid has several values", None),
        (json!({ "factors": [] }), "factors: names none", Some(Fix::set("factors", "all"))),
        (json!({ "num_envs": 0 }), "num_envs=0: use 1 to 65536", None),
        (json!({ "threads": 0 }), "threads=0: use 1 to 1024", None),
        (json!({ "again": true }), "again=true: is about a folder", Some(Fix::give("out"))),
        (json!({ "shard": "1/2" }), "shard=1/2: is about a folder", Some(Fix::give("out"))),
        (
            json!({ "shard": "1/2", "join": true, "out": out }),
            "these exclude each other",
            any(&[Fix::Leave("shard"), Fix::Leave("join")]),
        ),
        (json!({ "join": true, "out": out }), "holds no parts", None),
        (json!({ "factors": ["point.gian"] }), "factors=point.gian: unknown factor", None),
        (json!({ "manifest": folder.path().join("none.toml") }), "none.toml", None),
    ];
    for (given, text, fix) in table {
        let error = match ask(&task, given.clone(), &mut ()) {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{given}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        if fix.is_some() {
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
        }
    }
    assert!(!out.join("sweep.json").exists());
}

#[test]
fn the_same_sweep_is_not_run_twice_and_another_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let mut notes: Vec<Message> = Vec::new();
    let first = sweep(&task, json!({ "out": out }), &mut notes);
    assert_eq!((first.cells.len(), first.cells[0].successes.len()), (2, 3));
    assert!(notes.is_empty(), "{notes:?}");
    assert_eq!(sweep(&task, json!({ "out": out }), &mut notes), first);
    assert!(notes[0].to_string().ends_with("sweep.json: already done; give again=true to repeat it"));
    let other = json!({ "out": out, "policy": "constant" });
    let error = ask(&task, other, &mut ()).unwrap_err();
    assert!(error.to_string().contains("a sweep with policy `random`, not `constant`"), "{error}");
    let again = json!({ "out": out, "policy": "constant", "again": true });
    assert_eq!(sweep(&task, again, &mut ()).candidate.policy.name, "constant");
}

#[test]
fn joined_parts_are_the_whole_sweep() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let whole = sweep(&task, json!({ "num_envs": 1 }), &mut ());
    for shard in ["2/2", "1/2"] {
        let part = ask(&task, json!({ "out": out, "shard": shard }), &mut ());
        assert!(matches!(part, Ok(Swept::Part(_, 3))), "{part:?}");
    }
    assert_eq!(sweep(&task, json!({ "out": out, "join": true }), &mut ()), whole);
}
