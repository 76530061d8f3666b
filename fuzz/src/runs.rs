//! Training runs, of which a file has the bytes of the fuzzer: settings, checkpoints, metrics, weights.

use std::path::Path;

use swm_baselines::train::{RunFolder, TrainedModel, Which};
use swm_baselines::Device;
use swm_checkpoints::import::Import;
use swm_core::Registry;
use swm_tasks::request::Request as _;

use crate::sample::{Sample, Samples};

/// Checkpoints that are runs once they are imported.
const IMPORTED: [&str; 3] = ["gcbc", "lewm_trainer", "pldm"];

/// Runs of the fixtures of the tests.
pub fn samples() -> Samples {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/checkpoints");
    let made = IMPORTED.iter().map(|name| {
        Sample::new(name, |out| {
            let request = Import {
                from: golden.join(name).display().to_string(),
                out: out.to_owned(),
                action_mean: Some(vec![0.0; 2]),
                action_std: Some(vec![1.0; 2]),
                ..Import::default()
            };
            // What else a checkpoint needs is of no matter here: then its folder has no file.
            if request.run(&Registry::new(), &mut ()).is_err() {
                std::fs::create_dir_all(out).expect("there is room");
            }
        })
    });
    Samples::new(made.collect())
}

/// Reads it.
pub fn read(path: &Path) {
    let _ = TrainedModel::open(path, Which::default(), Device::Cpu);
    if let Ok(run) = RunFolder::open(path) {
        let _ = run.steps();
    }
}
