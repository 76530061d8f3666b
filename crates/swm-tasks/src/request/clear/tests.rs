//! Files in the form of the benchmark, made here: rules of the four tasks, rows of a dataset, and what is refused.

use serde_json::json;
use swm_core::testing::TOY;
use swm_core::{Registry, Rollout, World, WorldOptions, policies};
use swm_data::WriteMode;

use super::*;
use crate::request::{MakeManifest, Request as _};

fn registry() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(&[TOY])
}

/// A manifest of a task with one pair, and these settings of its protocol.
fn manifest(task: &str, tier: &str, protocol: &Json) -> Json {
    let mut all = json!({
        "name": tier, "description": "words", "eval_budget": 50, "success_mode": "task-sustained", "sustained_steps": 1,
        "goal_offset": 25, "exclude_initial_success": true, "min_difficulty": {},
        "cube_position_threshold_m": 0.04, "cube_symmetry_aware": false, "cube_orientation_threshold_deg": null,
        "pusht_position_threshold": 20, "pusht_angle_threshold_deg": 20, "pusht_block_only": false, "pusht_sustained_steps": null,
        "reacher_joint_threshold_rad": 0.05, "reacher_angle_mode": "shoulder-periodic", "reacher_success_mode": "joint",
        "tworoom_distance_threshold": 16, "tworoom_collision_mode": "swept", "tworoom_route_required": false,
    });
    for (name, value) in protocol.as_object().unwrap() {
        all[name] = value.clone();
    }
    json!({
        "schema_version": SCHEMA, "task": task, "seed": 7, "policy_seed": 7, "protocol": all, "split": "all",
        "dataset": { "name": "published.h5", "episode_column": "ep_idx" },
        "pairs": [{ "pair_id": 0, "episode_id": 1, "start_step": 1, "goal_step": 3, "start_row": 7, "goal_row": 9, "difficulty": 3.5 }],
    })
}

fn read(json: &Json) -> Result<ClearManifest, TaskError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clear.json");
    std::fs::write(&path, json.to_string()).unwrap();
    ClearManifest::read(&path)
}

fn rules(task: &str, env: &str, settings: &Json, protocol: &Json) -> (SuccessRule, Vec<Message>) {
    let mut notes = Vec::new();
    let settings = settings.as_object().unwrap();
    let read = read(&manifest(task, "moderate", protocol)).unwrap();
    (read.rules(env, settings, &mut notes).unwrap().success, notes)
}

#[test]
fn moderate_and_strict_rules_are_those_of_the_tiers() {
    let none = json!({});
    let tier = |env: &str, settings: &Json, tier| {
        tier_rules(env, settings.as_object().unwrap(), tier).unwrap().success
    };
    let matching = json!({ "task": "qpos_match" });
    for (task, env) in TASKS {
        let settings = if task == "reacher" { &matching } else { &none };
        let (found, _) = rules(task, env, settings, &none);
        let mut wanted = tier(env, settings, Tier::Moderate);
        // Degrees as radians, in another order of operations.
        for (found, wanted) in found.all.iter().zip(&mut wanted.all) {
            assert!((found.below - wanted.below).abs() < 1e-12, "{task}");
            wanted.below = found.below;
        }
        assert_eq!(found, wanted, "{task}");
    }
    let strict = json!({ "pusht_block_only": true, "pusht_position_threshold": 10, "pusht_angle_threshold_deg": 10, "pusht_sustained_steps": 3 });
    let (found, _) = rules("pusht", "swm/PushT-v1", &none, &strict);
    assert_eq!((found.hold, &found.all[0]), (3, &tier("swm/PushT-v1", &none, Tier::Strict).all[0]));
    let strict = json!({ "cube_symmetry_aware": true, "cube_orientation_threshold_deg": 15.0, "cube_sustained_steps": 3 });
    let (found, _) = rules("cube", "swm/OGBCube-v0", &none, &strict);
    assert_eq!((found.hold, found.all[1].measure), (3, Measure::CubeRotation));
    let (found, notes) = rules(
        "reacher",
        "swm/ReacherDMControl-v0",
        &matching,
        &json!({ "reacher_success_mode": "endpoint", "reacher_endpoint_threshold_m": 0.015 }),
    );
    assert_eq!(found.all, tier("swm/ReacherDMControl-v0", &matching, Tier::Strict).all);
    assert!(notes[0].text.contains("fingertip"), "{notes:?}");
    let (found, _) =
        rules("reacher", "swm/ReacherDMControl-v0", &matching, &json!({ "reacher_angle_mode": "raw" }));
    assert_eq!((found.all[0].measure, &found.all[0].elements[..]), (Measure::Largest, &[0, 1][..]));
}

#[test]
fn what_is_not_judged_is_noted() {
    let strict = json!({ "tworoom_route_required": true, "tworoom_later_rule": 3, "cube_later_rule": 4 });
    let (found, notes) = rules("tworoom", "swm/TwoRoom-v2", &json!({}), &strict);
    assert_eq!(found.all[0].below.to_bits(), 16_f64.to_bits());
    let [note] = &notes[..] else { panic!("{notes:?}") };
    assert!(
        note.text
            .ends_with("tworoom_collision_mode=swept, tworoom_route_required=true, tworoom_later_rule=3"),
        "{note}"
    );
    let official = manifest("pusht", "official", &json!({ "success_mode": "upstream" }));
    let official = read(&official).unwrap();
    let found = official.rules("swm/PushT-v1", &Map::new(), &mut ()).unwrap();
    assert!(found.success.is_environment() && official.tier == Tier::Historic);
}

#[test]
fn wrong_manifests_are_refused() {
    let none = json!({});
    let refused = |json: &Json| read(json).err().unwrap().to_string();
    let mut other = manifest("pusht", "moderate", &none);
    other["schema_version"] = "v9".into();
    assert!(refused(&other).contains("its form is `v9`"));
    assert!(refused(&manifest("pusht", "clear-id", &none)).contains("protocol is `clear-id`"));
    other = manifest("pusht", "moderate", &none);
    other["pairs"] = json!([]);
    assert!(refused(&other).contains("no pairs"));
    assert!(refused(&json!({ "task": "pusht" })).contains("is no manifest of CLEAR-LeWM"));
    let rules = |task: &str, env: &str, protocol: &Json| {
        read(&manifest(task, "moderate", protocol)).unwrap().rules(env, &Map::new(), &mut ()).unwrap_err()
    };
    let error = rules("pusht", "swm/TwoRoom-v2", &none);
    assert!(error.to_string().contains("pusht, is swm/PushT-v1 here, not swm/TwoRoom-v2"), "{error}");
    assert_eq!(error.fix(), Some(&Fix::set("env", "swm/PushT-v1")));
    assert!(rules("chess", "swm/PushT-v1", &none).to_string().contains("its task is `chess`"));
    let error = rules("pusht", "swm/PushT-v1", &json!({ "success_mode": "cube-pose" }));
    assert!(error.to_string().contains("success_mode is `cube-pose`"), "{error}");
    let error = rules("cube", "swm/OGBCube-v0", &json!({ "cube_orientation_threshold_deg": 15 }));
    assert!(error.to_string().contains("tells the sides of a cube apart"), "{error}");
    let error = rules("pusht", "swm/PushT-v1", &json!({ "pusht_position_threshold": null }));
    assert!(error.to_string().contains("no number `pusht_position_threshold`"), "{error}");
}

#[test]
fn rows_must_lie_where_the_manifest_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let [data, clear, out] = ["toy.h5", "clear.json", "task.toml"].map(|name| folder.path().join(name));
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(5)).unwrap();
    world.set_policy(policies::random()).unwrap();
    let mut writer = swm_data::create(&data, WriteMode::Error, None).unwrap();
    world.record_dataset(&Rollout::new(0..3), writer.as_mut()).unwrap();
    drop(writer);
    let dataset = swm_data::open(&data).unwrap();
    let first = dataset.episode_len(0);
    let mut json = manifest("pusht", "moderate", &json!({}));
    json["pairs"][0]["start_row"] = (first + 1).into();
    json["pairs"][0]["goal_row"] = (first + 3).into();
    let pairs = read(&json).unwrap().pairs(dataset.as_ref()).unwrap();
    assert_eq!(pairs, ["1:1-3".parse().unwrap()]);
    json["pairs"][0]["start_row"] = (first + 2).into();
    let error = read(&json).unwrap().pairs(dataset.as_ref()).unwrap_err();
    assert!(error.to_string().contains("its pair 1:1-3 is rows"), "{error}");
    assert_eq!(error.fix(), Some(&Fix::Change("dataset")));
    json["pairs"][0]["episode_id"] = 9.into();
    assert!(read(&json).unwrap().pairs(dataset.as_ref()).is_err());

    // The request asks for a dataset, and for nothing that the manifest says.
    std::fs::write(&clear, json.to_string()).unwrap();
    let request = MakeManifest { env: TOY.id.to_owned(), out, clear: Some(clear), ..MakeManifest::default() };
    let refused = |request: &MakeManifest| request.run(&registry(), &mut ()).unwrap_err();
    assert!(refused(&request).to_string().contains("is about a dataset, and none is named"));
    let request = MakeManifest { dataset: Some(data), ..request };
    let error = refused(&MakeManifest { seed: 3, ..request.clone() });
    assert!(error.to_string().contains("seed=3: does not go with a manifest of CLEAR-LeWM"), "{error}");
    assert_eq!(error.fix(), Some(&Fix::Any(vec![Fix::Leave("seed"), Fix::Leave("clear")])));
    let error = refused(&request);
    assert!(error.to_string().contains("pusht, is swm/PushT-v1 here"), "{error}");
}
