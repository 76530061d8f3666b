//! The frozen world model of a run, for a training over its latents.

use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};

use super::checkpoints::Checkpoint;
use super::data::{DataConfig, TrainData};
use super::fit::State;
use super::folder::RunFolder;
use super::run::{RunConfig, Which, find};
use crate::error::BaselineError;
use crate::models::WorldConfig;

/// A world model's last checkpoint.
pub(super) struct FrozenWorld {
    config: WorldConfig,
    /// How its vectors are scaled.
    pub(super) data: DataConfig,
    /// Its weights, whose hash has been compared.
    pub(super) weights: PathBuf,
}

impl FrozenWorld {
    /// That of the run at `path`; `baseline` is what is trained over its latents.
    pub(super) fn of(path: Option<&Path>, baseline: &'static str) -> Result<Self, BaselineError> {
        let wrong = |reason: &str| BaselineError::Settings { baseline, reason: reason.to_owned() };
        let Some(path) = path else {
            return Err(wrong(
                "its world model is not trained, and would be random; give a run of one as `encoder`, such as a run of lewm",
            ));
        };
        if path.is_file() {
            return Err(wrong(
                "a file of weights does not say what its world model is; give the folder of a run as `encoder`, and import a \
                 published checkpoint first: `swm import`",
            ));
        }
        let run = RunFolder::open(path)?;
        let RunConfig { model_config, data, .. } = RunConfig::read(&run)?;
        let checkpoint: Checkpoint<State> = run.checkpoint(find(&run, Which::Last)?)?;
        let weights = run.checked_weights(&checkpoint)?;
        Ok(Self { config: WorldConfig::new(model_config, checkpoint.weights), data, weights })
    }

    /// Settings that differ from the preset's, with it among them.
    pub(super) fn within(&self, changes: &Json) -> Json {
        let mut changes = if changes.is_null() { json!({}) } else { changes.clone() };
        // What is no group of settings is refused where the model is made.
        if let Some(all) = changes.as_object_mut() {
            let model = all.entry("model").or_insert(Json::Null);
            if model.is_null() {
                *model = json!({});
            }
            if let Some(model) = model.as_object_mut() {
                model.insert("world".to_owned(), json!(self.config));
            }
        }
        changes
    }
}

impl TrainData {
    /// Scales vectors as `other` does, where it has scales, and not by statistics of this dataset.
    pub(super) fn take_scales(&mut self, other: &DataConfig) {
        for (name, scale) in &mut self.config.scales {
            if let Some(known) = other.scales.get(name) {
                scale.clone_from(known);
            }
        }
    }
}
