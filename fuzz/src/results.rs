//! Files of tasks and results: manifests, receipts, ledgers of evaluations that go on, bundles, boards, statistics, settings of policies.

use std::fs;
use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::testing::TOY;
use swm_core::Registry;
use swm_data::stats::{Statistics, StatisticsOptions};
use swm_tasks::board::Board;
use swm_tasks::bundle::Bundle;
use swm_tasks::evaluation::{read_manifest, read_receipt, read_sweep};
use swm_tasks::report_page::Item;
use swm_tasks::request::{Evaluate, MakeBundle, MakeManifest, Request, policy_args};

use crate::sample::{Sample, Samples};

fn registry() -> Registry {
    crate::registry().with(&[TOY])
}

/// Runs a request that must succeed.
fn run<R: Request>(given: Json) {
    let Json::Object(given) = given else { unreachable!("requests are objects") };
    let given: Map<String, Json> = given;
    R::from_json(&given).and_then(|asked| asked.run(&registry(), &mut ())).expect("a sound request");
}

fn manifest(path: &Path) {
    run::<MakeManifest>(json!({ "env": TOY.id, "out": path, "episodes": 3, "budget": 4 }));
}

fn evaluate(out: &Path) {
    let task = out.with_extension("task.json");
    manifest(&task);
    run::<Evaluate>(json!({ "manifest": task, "policy": "random", "reference": ["no-op"], "out": out }));
}

/// One of each kind.
pub fn samples() -> Samples {
    Samples::new(vec![
        Sample::new("m.json", manifest),
        Sample::new("m.toml", manifest),
        Sample::new("result", evaluate),
        Sample::new("bundle", |out| {
            let result = out.with_extension("result");
            evaluate(&result);
            run::<MakeBundle>(json!({ "result": result, "out": out }));
        }),
        Sample::new("data", |folder| {
            fs::create_dir(folder).expect("there is room");
            let file = folder.join("a.h5");
            swm_data::testing::mutations::seed_in(&registry(), &file);
            let mut dataset = swm_data::open(&file).expect("it was just written");
            let statistics = Statistics::compute(dataset.as_mut(), &StatisticsOptions::default());
            statistics.and_then(|found| found.store(dataset.as_ref())).expect("the values are finite");
        }),
        Sample::new("settings.toml", |path| fs::write(path, "sigma = 0.3\n").expect("there is room")),
        Sample::new("settings.json", |path| fs::write(path, "{\"sigma\": 0.3}").expect("there is room")),
    ])
}

/// Reads it as whatever it may be. Only that it ends counts: most bytes are refused.
pub fn read(path: &Path) {
    if let Ok(task) = read_manifest(path) {
        let _ = task.check();
    }
    let _ = read_receipt(path);
    let _ = Item::read(path);
    let _ = read_sweep(path);
    let _ = policy_args(&registry(), &format!("ou:@{}", path.display()));
    if let Ok(bundle) = Bundle::open(path) {
        let _ = Board::new("Results", &[(bundle, None)]);
    }
    if let Ok(dataset) = swm_data::open(&path.join("a.h5")) {
        let _ = Statistics::load(dataset.as_ref());
    }
}
