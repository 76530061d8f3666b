//! Tests of evaluations as requests: refusals, results that are there already, and parts.

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::error::BoxError;
use swm_core::testing::TOY;
use swm_core::{Cancel, Registry, Rollout, World, WorldOptions, policies};

use super::{Evaluate, Evaluated};
use crate::evaluation::Role;
use crate::request::{Fix, MakeManifest, Message, Progress, Report, Request as _, Stage, TaskError};

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(swm_data_foreign::LAYOUTS).with(&[TOY])
}

fn object(json: Json) -> Map<String, Json> {
    match json {
        Json::Object(map) => map,
        other => panic!("{other} is no object"),
    }
}

fn manifest(path: &Path) {
    let request = MakeManifest {
        env: TOY.id.to_owned(),
        out: path.to_owned(),
        episodes: 3,
        budget: Some(5),
        ..MakeManifest::default()
    };
    request.run(&registry(), &mut ()).unwrap();
}

fn record(path: &Path) {
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(5)).unwrap();
    world.set_policy(policies::random()).unwrap();
    let mut writer = swm_data::create(path, swm_data::WriteMode::Error, None).unwrap();
    world.record_dataset(&Rollout::new(0..3), writer.as_mut()).unwrap();
}

fn ask(given: Json) -> Result<Evaluated, TaskError> {
    Evaluate::from_json(&object(given)).and_then(|asked| asked.run(&registry(), &mut ()))
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let [task, data, out, full] = ["task.toml", "toy.h5", "out", "full"].map(|name| folder.path().join(name));
    manifest(&task);
    record(&data);
    std::fs::create_dir(&full).unwrap();
    std::fs::write(full.join("result.json"), "{}").unwrap();
    let (leave, give) = (Fix::Leave, Fix::give);
    let any = |fixes: &[Fix]| Some(Fix::Any(fixes.to_vec()));
    let on = |given: Json| {
        let mut asked = object(json!({ "manifest": task }));
        asked.extend(object(given));
        Json::Object(asked)
    };
    let online = |given: Json| {
        let mut asked = object(json!({ "env": TOY.id }));
        asked.extend(object(given));
        Json::Object(asked)
    };
    let replace = Fix::set_to("again", true, "to replace it");
    let table = [
        (json!({}), "nothing names the environment", any(&[give("env"), give("manifest")])),
        (online(json!({ "policy": "" })), "policy: must be given", None),
        (online(json!({ "episods": 3 })), "did you mean `episodes`?", None),
        (online(json!({ "episodes": 0 })), "episodes=0: nothing is evaluated", None),
        (online(json!({ "budget": 0 })), "budget=0: no action is allowed", None),
        (
            online(json!({ "dataset": data, "goal_offset": 0 })),
            "goal_offset=0: every start would be its goal",
            None,
        ),
        (
            online(json!({ "goal_offset": 3 })),
            "goal_offset=3: is about a dataset",
            any(&[give("dataset"), leave("goal_offset")]),
        ),
        (
            online(json!({ "opening": { "flip": "180" } })),
            "flip: is about a dataset, and none is named",
            any(&[give("dataset"), leave("flip")]),
        ),
        (
            on(json!({ "opening": { "flip": "180" } })),
            "flip: the manifest fixes it",
            any(&[leave("flip"), leave("manifest")]),
        ),
        (online(json!({ "dataset": data, "opening": { "flip": "180" } })), "has no use for it", None),
        (online(json!({ "num_envs": 0 })), "num_envs=0: use 1 to 65536", None),
        (online(json!({ "threads": 0 })), "threads=0: use 1 to 1024", None),
        (
            online(json!({ "policy_seed": 3 })),
            "policy_seed=3: is for evaluations on a manifest",
            any(&[give("manifest"), give("seed")]),
        ),
        (
            online(json!({ "oracle": "random" })),
            "oracle=random: is for evaluations on a manifest",
            any(&[give("manifest"), give("policy")]),
        ),
        (
            online(json!({ "reference": ["random"] })),
            "reference=random: is for evaluations on a manifest",
            any(&[give("manifest"), give("policy")]),
        ),
        (online(json!({ "plan_steps": 3 })), "plan_steps=3: is for evaluations", any(&[give("manifest")])),
        (
            online(json!({ "shard": "1/2", "out": out })),
            "shard=1/2: is for evaluations on a manifest",
            any(&[give("manifest")]),
        ),
        (
            online(json!({ "join": true, "out": out })),
            "join=true: is for evaluations on a manifest",
            any(&[give("manifest")]),
        ),
        (online(json!({ "again": true })), "again=true: is about a folder", Some(give("out"))),
        (
            online(json!({ "video_format": "webm" })),
            "video_format=webm: no format of videos",
            Some(Fix::Choose(vec!["mp4".to_owned(), "gif".to_owned()])),
        ),
        (online(json!({ "image_size": "big" })), "image_size=big: ", None),
        (online(json!({ "dataset": folder.path().join("none.h5") })), "none.h5", None),
        (
            online(json!({ "out": full, "videos": 0 })),
            "holds the result of an evaluation, result.json",
            any(&[Fix::Change("out"), replace.clone()]),
        ),
        (online(json!({ "vary": ["gian"] })), "vary=gian: unknown factor", None),
        (on(json!({ "shard": "3/2", "out": out })), "shard=3/2: must be part I of N parts", None),
        (on(json!({ "shard": "1/2" })), "shard=1/2: is about a folder", Some(give("out"))),
        (
            on(json!({ "shard": "1/2", "join": true, "out": out })),
            "these exclude each other",
            any(&[leave("shard"), leave("join")]),
        ),
        (
            on(json!({ "join": true, "again": true, "out": out })),
            "these exclude each other",
            any(&[leave("join"), leave("again")]),
        ),
        (on(json!({ "join": true, "out": out })), "holds no parts", None),
        (on(json!({ "reference": ["best"] })), "reference=best: no reference policy", None),
        (
            on(json!({ "reference": ["none", "random"] })),
            "reference=none,random: `none` goes with no other",
            None,
        ),
        (on(json!({ "seed": 3 })), "seed=3: the manifest fixes it", any(&[leave("seed"), leave("manifest")])),
        (on(json!({ "env": TOY.id })), "the manifest fixes it", any(&[leave("env"), leave("manifest")])),
        (json!({ "manifest": folder.path().join("none.toml") }), "none.toml", None),
        (json!({ "manifest": { "env": TOY.id, "pear": 3 } }), "the manifest: ", None),
    ];
    for (given, text, fix) in table {
        let mut asked = object(json!({ "policy": "random" }));
        asked.extend(object(given));
        let error = match ask(Json::Object(asked.clone())) {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{asked:?}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        if fix.is_some() {
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
        }
    }
    assert!(!out.join("receipt.json").exists());
}

#[test]
fn the_same_evaluation_is_not_run_twice_and_another_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let mut request = Evaluate {
        manifest: Some(super::ManifestSource::File(task)),
        policy: "random".to_owned(),
        reference: vec!["no_op".to_owned()],
        out: Some(out),
        ..Evaluate::default()
    };
    let mut notes: Vec<Message> = Vec::new();
    let mut receipt = |request: &Evaluate| match request.run(&registry(), &mut notes) {
        Ok(Evaluated::Receipt(receipt, Some(_))) => Ok(receipt),
        Ok(other) => panic!("{other:?}"),
        Err(error) => Err(error),
    };
    let first = receipt(&request).unwrap();
    assert_eq!((first.episodes.len(), first.references.len()), (3, 1));
    assert_eq!(receipt(&request).unwrap(), first);
    request.policy = "constant".to_owned();
    let error = receipt(&request).unwrap_err();
    assert!(error.to_string().contains("policy `random`, not `constant`"), "{error}");
    let replace = Fix::set_to("again", true, "to replace it");
    assert_eq!(error.fix(), Some(&Fix::Any(vec![Fix::Change("out"), replace])));
    request.again = true;
    assert!(receipt(&request).is_ok());
    assert!(
        notes.iter().any(|note| note.to_string().ends_with("already done; give again=true to repeat it"))
    );
}

#[test]
fn joined_parts_are_the_whole_receipt() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let given = |more: Json| {
        let mut asked = object(json!({ "manifest": task, "policy": "random", "reference": ["no-op"] }));
        asked.extend(object(more));
        Json::Object(asked)
    };
    let receipt = |given| match ask(given) {
        Ok(Evaluated::Receipt(receipt, _)) => *receipt,
        other => panic!("{other:?}"),
    };
    let mut whole = receipt(given(json!({ "num_envs": 1 })));
    for shard in ["2/2", "1/2"] {
        assert!(matches!(ask(given(json!({ "out": out, "shard": shard }))), Ok(Evaluated::Part(_, 3))));
    }
    let joined = receipt(given(json!({ "out": out, "join": true })));
    whole.wall_time_s = joined.wall_time_s;
    assert_eq!(whole, joined);
}

/// Rows of another program, whose states and actions are of another kind.
#[test]
fn a_dataset_that_does_not_fit_is_refused() {
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field/pusht_cchi_v7_replay.zarr");
    let refused = |map: Json| {
        let asked = json!({
            "env": TOY.id, "policy": "random", "dataset": golden, "opening": { "map": map }, "goal_offset": 2, "episodes": 2,
        });
        ask(asked).unwrap_err().to_string()
    };
    let text = refused(json!({}));
    assert!(text.contains("its `state` has 5 values a row, that of swm/Toy-v0 has 1"), "{text}");
    let text = refused(json!({ "state": "n_contacts", "all": "state" }));
    assert!(text.contains("its actions have 2 values, those of swm/Toy-v0 1"), "{text}");
    let text = refused(json!({ "state": "n_contacts", "all": "state", "action": "n_contacts" }));
    assert!(text.contains("map") && text.contains("two names"), "{text}");
}

/// Ends the work where the reference policy `no-op` begins, unless it goes on; keeps what is told.
#[derive(Default)]
struct Stops {
    cancel: Cancel,
    goes_on: bool,
    told: Vec<String>,
}

impl Report for Stops {
    fn note(&mut self, note: &Message) {
        self.told.push(note.to_string());
    }

    fn info(&mut self, info: &Message) {
        self.told.push(info.to_string());
    }

    fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        if stage.role == Some(Role::NoOp) && !self.goes_on {
            self.cancel.cancel();
        }
        Ok(Box::new(()))
    }
}

#[test]
fn an_evaluation_that_is_interrupted_among_its_references_keeps_every_episode() {
    let folder = tempfile::tempdir().unwrap();
    let [task, out] = ["task.toml", "out"].map(|name| folder.path().join(name));
    manifest(&task);
    let given = json!({ "manifest": task, "policy": "random", "reference": ["no-op"], "out": out });
    let asked = Evaluate::from_json(&object(given)).unwrap();
    let mut first = Stops::default();
    asked.run(&registry(), &mut first).unwrap_err();
    assert!(out.join("episodes.jsonl").exists() && !out.join("receipt.json").exists());
    let mut second = Stops { goes_on: true, ..Stops::default() };
    asked.run(&registry(), &mut second).unwrap();
    assert!(second.told.iter().any(|text| text == "3 of 3 episodes done already"), "{:?}", second.told);
    let left: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".jsonl")), "{left:?}");
}
