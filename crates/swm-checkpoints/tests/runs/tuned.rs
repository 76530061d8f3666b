//! A run that begins with the weights of another one.

use std::path::Path;

use serde_json::json;
use swm_baselines::Device;
use swm_baselines::train::{NewRun, Origin, PreparedRun, RunConfig, RunFolder, Training};
use swm_data::format::built_in;

use super::dot::WIDE;
use super::{IMAGE, new_run, record, record_as, record_in, trained};

fn config(run: &Path) -> RunConfig {
    RunConfig::read(&RunFolder::open(run).unwrap()).unwrap()
}

#[test]
fn a_run_begins_with_the_model_of_another_one_and_trains_on() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    record(folder.path());
    trained(folder.path(), "lewm", "first");
    let (first, known) = (at("first"), config(&at("first")));
    let other = record_as(&at("other.h5"), Some(IMAGE), 77);

    // The model is that of the run, whatever the preset; settings that are given are laid over its own.
    let tune = |changes| NewRun { changes, from: Some(&first), preset: "paper", ..new_run("lewm") };
    let new = tune(json!({ "optim": { "lr": 1e-5 } }));
    let prepared = PreparedRun::new(built_in(), other.as_ref(), &new).unwrap();
    prepared.model().save_weights(&at("begun.safetensors")).unwrap();
    let begun = swm_weights::read(&at("begun.safetensors")).unwrap();
    let last = swm_weights::read(&RunFolder::open(&first).unwrap().weights(9)).unwrap();
    assert!(begun.len() > 10 && begun == last, "it begins with other weights");
    prepared.create(&at("second")).unwrap().run(Vec::new()).unwrap();

    let second = config(&at("second"));
    let mut settings = known.model_config.settings.clone();
    settings["optim"]["lr"] = json!(1e-5);
    assert_eq!(second.model_config.settings, settings);
    assert_eq!(second.data.scales, known.data.scales);
    assert_ne!(second.data.path, known.data.path);
    let Some(Origin { run, step, weights }) = second.from else { panic!("it names the run") };
    assert_eq!((run, step, weights.len()), (first.clone(), 9, 64));
    assert_eq!(known.from, None);
    let after = swm_weights::read(&RunFolder::open(&at("second")).unwrap().weights(9)).unwrap();
    assert!(after != last, "it learns");
    // It goes on with the scales that it has, which are none of its dataset's.
    let resumed = Training::resume(built_in(), &at("second"), Device::Cpu, None, |fit| fit.steps = Some(12));
    assert_eq!(resumed.unwrap().run(Vec::new()).unwrap().step, 12);
}

#[test]
fn a_run_that_does_not_fit_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = record(folder.path());
    trained(folder.path(), "lewm", "first");
    let first = at("first");
    let fails = |dataset: &dyn swm_data::Dataset, new: NewRun<'_>| {
        let new = NewRun { from: Some(&first), ..new };
        let refused = Training::create(built_in(), &at("run"), dataset, &new).err().expect("it is refused");
        assert!(!at("run").exists());
        refused.to_string()
    };
    let message = fails(dataset.as_ref(), new_run("gcbc"));
    assert!(message.contains("it trained lewm, and gcbc is asked for"), "{message}");
    let wide = record_in(&WIDE, &at("wide.h5"), Some(IMAGE), 1);
    let message = fails(wide.as_ref(), new_run("lewm"));
    assert!(message.contains("its model takes actions of 2 values, and the dataset has 3"), "{message}");
    let message = fails(dataset.as_ref(), NewRun { changes: json!({ "modl": 1 }), ..new_run("lewm") });
    assert!(message.contains("did you mean `model`"), "{message}");
    let smaller = json!({ "model": { "latent_dim": 4 } });
    let message = fails(dataset.as_ref(), NewRun { changes: smaller, ..new_run("lewm") });
    assert!(message.contains("of another shape"), "{message}");
    let agent = at("empty");
    std::fs::create_dir(&agent).unwrap();
    let nothing = NewRun { from: Some(&agent), ..new_run("lewm") };
    assert!(Training::create(built_in(), &at("run"), dataset.as_ref(), &nothing).is_err());
}
