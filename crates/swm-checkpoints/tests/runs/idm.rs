//! GC-IDM over the latents of a trained LeWM: as a policy, and as what searches on that LeWM begin from.

use std::fs;

use serde_json::json;
use swm_baselines::Device;
use swm_baselines::train::{FitSettings, NewRun, RunConfig, RunFolder, Split, Training};
use swm_checkpoints::POLICIES;
use swm_core::PolicyArgs;
use swm_data::format::built_in;

use super::dot::SIDE;
use super::{BreakAt, IMAGE, made, new_run, paths, record, record_as, trained};

#[test]
fn a_policy_over_latents_is_trained_goes_on_acts_and_proposes_plans() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record(folder.path());
    trained(folder.path(), "lewm", "world");
    let world = at("world");
    let changes = json!({ "model": { "hidden": 16, "depth": 2, "horizon": 2 } });
    let new = NewRun { changes, encoder: Some(&world), ..new_run("gc-idm") };
    let create =
        |name: &str, new: &NewRun<'_>| Training::create(built_in(), &at(name), dataset.as_ref(), new);
    let whole = create("whole", &new).unwrap().run(Vec::new()).unwrap();
    assert!(whole.step == 9 && whole.validation.iter().all(|(_, value)| value.is_finite()), "{whole:?}");
    let mut training = create("broken", &new).unwrap();
    training.run(vec![Box::new(BreakAt(4))]).unwrap_err();
    drop(training);
    let resumed = Training::resume(built_in(), &at("broken"), Device::Cpu, None, |_| ());
    assert_eq!(resumed.unwrap().run(Vec::new()).unwrap(), whole);
    let weights = |name: &str| fs::read(RunFolder::open(&at(name)).unwrap().weights(9)).unwrap();
    assert!(weights("whole") == weights("broken"), "the weights differ");

    // Its actions are scaled as the world model's, whatever the data is.
    let config = |name: &str| RunConfig::read(&RunFolder::open(&at(name)).unwrap()).unwrap();
    record_as(&at("other.h5"), Some(IMAGE), 77);
    let other = swm_data::open(&at("other.h5")).unwrap();
    let mut of_other = Training::create(built_in(), &at("other"), other.as_ref(), &new).unwrap();
    of_other.run(Vec::new()).unwrap();
    drop(of_other);
    assert_eq!(config("other").data.scales, config("world").data.scales);
    assert!(
        Training::resume(built_in(), &at("other"), Device::Cpu, None, |fit| fit.steps = Some(12)).is_ok()
    );

    // It acts, alone and beside others, also where its world model is gone.
    let run = at("whole").display().to_string();
    fs::rename(&world, at("elsewhere")).unwrap();
    let alone = paths(&format!("gc-idm:{run}"), 1, Some(IMAGE)).unwrap();
    assert_eq!(alone.0.len(), 4 * 25);
    assert!(alone.0 == paths(&format!("policy:{run}"), 3, Some(IMAGE)).unwrap().0);
    fs::rename(at("elsewhere"), &world).unwrap();

    // Without a search, a plan is what it proposes; a search goes on from there.
    let world = world.display();
    let plans = |settings: &str| format!("mpc:{world},proposal={run},horizon=2,receding_horizon=1{settings}");
    let zero = plans(",iterations=0");
    let planned = paths(&zero, 1, Some(IMAGE)).unwrap();
    assert!(planned.0 == paths(&zero, 3, Some(IMAGE)).unwrap().0);
    let still = format!("mpc:{world},horizon=2,receding_horizon=1,iterations=0");
    assert!(planned.0 != paths(&still, 1, Some(IMAGE)).unwrap().0, "no plan is another");
    // The first of two decisions of a plan is the first of two of the policy.
    let (of_plan, of_policy) = (&planned.0, &alone.0);
    assert!((0..4).all(|episode| of_plan[&(episode, 2)] == of_policy[&(episode, 2)]));
    let searched = plans(",iterations=2,samples=8,elites=2,history_len=2");
    assert!(paths(&searched, 1, Some(IMAGE)).unwrap().0 == paths(&searched, 3, Some(IMAGE)).unwrap().0);
    let described = made(&searched).unwrap().describe();
    assert!(described.contains("proposal=gc-idm@9#"), "{described}");
    let files = POLICIES[0].model_files(&PolicyArgs::parse(&searched).unwrap()).unwrap();
    assert_eq!(files.len(), 4, "{files:?}");

    let fails = |text: String| made(&text).err().unwrap();
    trained(folder.path(), "gcbc", "policy");
    let message = fails(format!("mpc:{world},proposal={}", at("policy").display()));
    assert!(message.contains("setting `proposal`: gcbc proposes no plans"), "{message}");
    let again = NewRun { fit: FitSettings { seed: 7, ..new_run("lewm").fit }, ..new_run("lewm") };
    create("twin", &again).unwrap().run(Vec::new()).unwrap();
    let message = fails(format!("mpc:{},proposal={run}", at("twin").display()));
    assert!(message.contains("learned over the latents of another world model"), "{message}");
    assert!(fails(format!("mpc:{run}")).contains("gc-idm is no world model"));
}

#[test]
fn a_training_over_latents_needs_a_run_of_a_world_model() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record(folder.path());
    trained(folder.path(), "gcbc", "policy");
    let refused = |encoder: Option<&std::path::Path>| {
        let changes = json!({ "model": { "hidden": 8, "horizon": 2 } });
        let new = NewRun { changes, encoder, split: Split::default(), ..new_run("gc-idm") };
        Training::create(built_in(), &at("run"), dataset.as_ref(), &new).err().unwrap().to_string()
    };
    for (encoder, part) in [
        (None, "give a run of one as `encoder`"),
        (Some(at("data.h5")), "a file of weights does not say what its world model is"),
        (Some(at("nothing")), "there is no such folder"),
        (Some(at("policy")), "gcbc is no world model"),
    ] {
        let message = refused(encoder.as_deref());
        assert!(message.contains(part), "{message}");
    }
    assert!(!at("run").exists());
    assert_eq!(SIDE, 16);
}
