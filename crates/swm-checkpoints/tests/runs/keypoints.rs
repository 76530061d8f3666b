//! A world model over the places that a policy's encoder finds: trained on latents that are encoded once.

use std::fs;

use serde_json::json;
use swm_baselines::Device;
use swm_baselines::train::{NewRun, RunFolder, Training};
use swm_data::format::built_in;

use super::{BreakAt, IMAGE, SIDE, made, new_run, paths, record};

#[test]
fn a_model_learns_from_latents_of_a_frozen_encoder_and_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record(folder.path());
    let train = |name: &str, new: &NewRun<'_>| {
        Training::create(built_in(), &at(name), dataset.as_ref(), new).unwrap().run(Vec::new()).unwrap()
    };
    let encoder = json!({ "kind": "keypoints", "channels": [4, 8], "count": 4 });
    let model = json!({ "image": SIDE, "encoder": encoder, "hidden": 8, "horizon": 2, "frameskip": 2 });
    train("policy", &NewRun { changes: json!({ "model": model }), ..new_run("gcsl") });

    let places = at("policy");
    let model = json!({ "image": SIDE, "encoder": { "channels": [4, 8], "count": 4 }, "hidden": 16 });
    let new = NewRun { changes: json!({ "model": model }), encoder: Some(&places), ..new_run("keypoint-wm") };
    let whole = train("whole", &new);
    assert!(whole.step == 9 && whole.validation.iter().all(|(_, value)| value.is_finite()), "{whole:?}");
    let mut training = Training::create(built_in(), &at("broken"), dataset.as_ref(), &new).unwrap();
    training.run(vec![Box::new(BreakAt(4))]).unwrap_err();
    drop(training);
    let resumed = Training::resume(built_in(), &at("broken"), Device::Cpu, None, |_| ());
    assert_eq!(resumed.unwrap().run(Vec::new()).unwrap(), whole);
    let weights = |name: &str| fs::read(RunFolder::open(&at(name)).unwrap().weights(9)).unwrap();
    assert!(weights("whole") == weights("broken"), "the weights differ");

    // Unless told otherwise, it plans single actions with the last one in sight.
    let plan = made(&format!("mpc:{}", at("whole").display())).unwrap().describe();
    let settings = ["horizon=25", "shrinking_horizon=true", "history_len=2", "action_block=1"];
    assert!(settings.iter().all(|setting| plan.contains(setting)), "{plan}");

    // It plans in the environment, alone and beside others.
    let mpc =
        format!("mpc:{},horizon=4,receding_horizon=2,samples=8,elites=2,iterations=2", at("whole").display());
    assert_eq!(paths(&mpc, 1, Some(IMAGE)).unwrap().0, paths(&mpc, 3, Some(IMAGE)).unwrap().0);
}
