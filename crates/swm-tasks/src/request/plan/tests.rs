//! Tests of plans as requests: refusals, and what is written.

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::Registry;
use swm_core::testing::TOY;

use super::{Plan, Planned};
use crate::request::{Fix, MakeManifest, Request as _, TaskError};

/// A planner that is done soon.
const QUICK: &str = "cem:samples=4,iterations=1,elites=2,horizon=2,receding_horizon=1";

fn registry() -> Registry {
    Registry::new().with(swm_solvers::SOLVERS).with(swm_solvers::PLANNERS).with(&[TOY])
}

/// Plans with these settings, of new episodes unless `given` says otherwise.
fn ask(given: Json) -> Result<Planned, TaskError> {
    let mut asked = Map::from_iter([("policy".to_owned(), QUICK.into())]);
    let Json::Object(given) = given else { panic!("{given} is no object") };
    asked.extend(given);
    Plan::from_json(&asked).and_then(|asked: Plan| asked.run(&registry(), &mut ()))
}

fn manifest(path: &Path) {
    let (env, out) = (TOY.id.to_owned(), path.to_owned());
    let request = MakeManifest { env, out, episodes: 3, budget: Some(2), ..MakeManifest::default() };
    request.run(&registry(), &mut ()).unwrap();
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let [task, full, other] = ["task.toml", "full", "other"].map(|name| folder.path().join(name));
    manifest(&task);
    for (dir, file) in [(&full, "trace.jsonl"), (&other, "notes.txt")] {
        std::fs::create_dir(dir).unwrap();
        std::fs::write(dir.join(file), "").unwrap();
    }
    let any = |fixes: &[Fix]| Some(Fix::Any(fixes.to_vec()));
    let (leave, give) = (Fix::Leave, Fix::give);
    let toy = |more: Json| {
        let mut given = Map::from_iter([("env".to_owned(), TOY.id.into()), ("budget".to_owned(), 2.into())]);
        given.extend(more.as_object().unwrap().clone());
        Json::Object(given)
    };
    let table = [
        (json!({}), "nothing names the environment", any(&[give("env"), give("manifest")])),
        (toy(json!({ "policy": "" })), "policy: must be given", None),
        (toy(json!({ "budge": 3 })), "did you mean `budget`?", None),
        (toy(json!({ "pair": 1 })), "pair=1: is a pair of a manifest", Some(give("manifest"))),
        (toy(json!({ "episodes": 0 })), "episodes=0: nothing is planned for", None),
        (toy(json!({ "budget": 0 })), "budget=0: no action is allowed", None),
        (
            toy(json!({ "plan_only": true })),
            "budget=2: a first plan takes one action",
            any(&[leave("budget"), leave("plan_only")]),
        ),
        (toy(json!({ "overwrite": true })), "overwrite=true: is about a folder", Some(give("trace"))),
        (
            toy(json!({ "details": "all", "trace": other })),
            "details=all: no part of an iteration",
            Some(Fix::Choose(["figures", "elites", "candidates"].map(str::to_owned).to_vec())),
        ),
        (toy(json!({ "video_format": "webm" })), "video_format=webm: no format of videos", None),
        (toy(json!({ "threads": 0 })), "threads=0: use 1 to 1024", None),
        (toy(json!({ "policy": "random" })), "the policy `random` makes no plans", None),
        (toy(json!({ "policy": "cme" })), "unknown solver `cme` (did you mean `cem`?)", None),
        (toy(json!({ "vary": ["point.gian"] })), "vary=point.gian: unknown factor", None),
        (
            toy(json!({ "trace": full })),
            "is not empty",
            any(&[Fix::Change("trace"), Fix::set_to("overwrite", true, "to replace an earlier trace in it")]),
        ),
        (
            toy(json!({ "trace": other, "overwrite": true })),
            "holds no earlier trace (trace.jsonl)",
            Some(Fix::Change("trace")),
        ),
        (
            json!({ "manifest": task, "seed": 3 }),
            "seed=3: the manifest fixes it",
            any(&[leave("seed"), leave("manifest")]),
        ),
        (json!({ "manifest": task, "pair": 3 }), "pair=3: the manifest holds 3 pairs", None),
        (json!({ "manifest": folder.path().join("none.toml") }), "none.toml", None),
    ];
    for (given, text, fix) in table {
        let error = match ask(given.clone()) {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{given}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        if fix.is_some() {
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
        }
    }
    assert!(other.join("notes.txt").is_file());
}

#[test]
fn plans_of_new_episodes_and_of_a_pair_are_summed_up_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let [task, trace] = ["task.toml", "trace"].map(|name| folder.path().join(name));
    manifest(&task);
    let two = json!({ "env": TOY.id, "episodes": 2, "budget": 2, "trace": trace, "video_format": "gif" });
    let Planned { summary, written } = ask(two).unwrap();
    assert_eq!((summary.episodes.len(), summary.env.as_str()), (2, TOY.id));
    let files = written.unwrap();
    assert!(files[0].ends_with("index.html") && files.iter().all(|file| file.is_file()), "{files:?}");
    assert!(trace.join("trace.jsonl").is_file());
    let pair = ask(json!({ "manifest": task, "pair": 2, "plan_only": true })).unwrap();
    assert_eq!((pair.summary.episodes[0].episode, pair.summary.plans.len()), (2, 1));
    assert!(pair.written.unwrap().is_empty());
}
