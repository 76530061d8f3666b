//! What a run's `config.json` says, and the model of a checkpoint.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::checkpoints::Checkpoint;
use super::data::{ACTION, DataConfig, PROPRIO};
use super::fit::State;
use super::folder::RunFolder;
use super::foreign::refuse_foreign;
use super::settings::FitSettings;
use crate::baseline::{Baseline, ModelConfig};
use crate::device::Device;
use crate::error::BaselineError;
use crate::models::table::restore;
use crate::online::online_agent;

/// The version of [`RunConfig`] that is written and read.
pub const RUN_VERSION: u32 = 1;

/// A run, but for its weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct RunConfig {
    /// [`RUN_VERSION`].
    pub version: u32,
    /// The model.
    #[serde(alias = "recipe")]
    pub model_config: ModelConfig,
    /// What it learns from.
    pub data: DataConfig,
    /// How long, and how often it is looked at; of a checkpoint of others, nobody knows.
    #[serde(default)]
    pub fit: FitSettings,
    /// Where it is from, if it is a checkpoint of others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
    /// The run with whose weights it began, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Origin>,
}

/// The run with whose weights another one began.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Its folder, as it was named.
    pub run: PathBuf,
    /// The checkpoint's step.
    pub step: u64,
    /// SHA-256 of its weights.
    pub weights: String,
}

/// Where a checkpoint of others is from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imported {
    /// What was named: a folder, a file, a repository.
    pub source: String,
    /// The file of weights.
    pub file: PathBuf,
    /// SHA-256 of it.
    pub sha256: String,
    /// Its container: `zip`, `legacy`, `tar`, `pickle`, `safetensors`.
    pub format: String,
    /// Whose names the encoder's tensors had.
    pub names: String,
    /// SHA-256 of its config, where it has one.
    pub config_sha256: Option<String>,
    /// Where the scale of actions is from.
    pub action_scale: Option<String>,
    /// Tensors that it lacks, which neither plans nor actions need: they are random.
    pub lacks: Vec<String>,
}

impl RunConfig {
    /// That of a run of this version.
    pub fn new(model_config: ModelConfig, data: DataConfig) -> Self {
        Self {
            version: RUN_VERSION,
            model_config,
            data,
            fit: FitSettings::default(),
            imported: None,
            from: None,
        }
    }

    /// That of a run.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has a version that this program does not read.
    pub fn read(run: &RunFolder) -> Result<Self, BaselineError> {
        if let Some(agent) = online_agent(run)? {
            return Err(run.wrong(format!("it trained an agent, not a model; use it as `{agent}:RUN`")));
        }
        refuse_foreign(run)?;
        let config: Self = run.config()?;
        if config.version != RUN_VERSION {
            let version = config.version;
            return Err(run.wrong(format!("it has version {version}, this program reads {RUN_VERSION}")));
        }
        config.check().map_err(|reason| run.damaged(&run.config_file(), &reason))?;
        Ok(config)
    }

    /// What is wrong within it, if anything is.
    fn check(&self) -> Result<(), String> {
        let Self { model_config: ModelConfig { dims, .. }, data, fit, .. } = self;
        fit.check().map_err(|error| error.to_string())?;
        if data.action != dims.action_dim {
            return Err(format!(
                "`data.action` is {}, and the model takes {} values",
                data.action, dims.action_dim
            ));
        }
        if !data.scales.contains_key(ACTION) {
            return Err(format!("`data.scales` has no `{ACTION}`"));
        }
        for (name, dim) in [(ACTION, dims.action_dim), (PROPRIO, dims.proprio_dim)] {
            if let Some(len) = data.scales.get(name).map(|scale| scale.mean.len()).filter(|len| *len != dim) {
                return Err(format!("`data.scales.{name}` has {len} values, and the model takes {dim}"));
            }
        }
        if data.frame_skip == Some(0) {
            return Err("`data.frame_skip` is 0; it must be at least 1".to_owned());
        }
        Ok(())
    }

    /// Whether `model`, which was made from it, fits what it says of the data.
    pub(super) fn check_model(&self, run: &RunFolder, model: &dyn Baseline) -> Result<(), BaselineError> {
        let (input, data) = (model.input_spec(), &self.data);
        let reason = if input.image != data.image {
            format!("`data.image` is {}, and the model takes images of {}", data.image, input.image)
        } else if input.proprio && !data.scales.contains_key(PROPRIO) {
            format!("`data.scales` has no `{PROPRIO}`, which the model takes")
        } else {
            return Ok(());
        };
        Err(run.damaged(&run.config_file(), &reason))
    }
}

/// Which checkpoint of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Which {
    /// The last.
    #[default]
    Last,
    /// That with the least validation loss, or an agent's with the greatest return.
    Best,
    /// That of this step.
    Step(u64),
}

impl FromStr for Which {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "last" => Ok(Self::Last),
            "best" => Ok(Self::Best),
            step => step.parse().map(Self::Step).map_err(|_| format!("`{step}`; use last, best or a step")),
        }
    }
}

/// A trained model and what it must be used with.
#[non_exhaustive]
pub struct TrainedModel {
    /// The model.
    pub baseline: Box<dyn Baseline>,
    /// Its run.
    pub config: RunConfig,
    /// The checkpoint's step.
    pub step: u64,
    /// SHA-256 of its weights.
    pub weights: String,
}

impl TrainedModel {
    /// One whose weights, of this step and hash, are loaded.
    pub fn new(baseline: Box<dyn Baseline>, config: RunConfig, step: u64, weights: String) -> Self {
        Self { baseline, config, step, weights }
    }

    /// Takes a checkpoint of the run in folder `path`, whose weights are those that were written.
    ///
    /// # Errors
    ///
    /// There is no run or no such checkpoint, or its files are not those that were written.
    pub fn open(path: &Path, which: Which, device: Device) -> Result<Self, BaselineError> {
        let run = RunFolder::open(path)?;
        let config = RunConfig::read(&run)?;
        let checkpoint: Checkpoint<State> = run.checkpoint(find(&run, which)?)?;
        let mut baseline = restore(&config.model_config, device)?;
        config.check_model(&run, baseline.as_ref())?;
        baseline.load_weights(&run.checked_weights(&checkpoint)?)?;
        Ok(Self { baseline, config, step: checkpoint.step, weights: checkpoint.weights })
    }

    /// The files that a model depends on.
    ///
    /// # Errors
    ///
    /// There is no run, or no such checkpoint.
    pub fn files(path: &Path, which: Which) -> Result<Vec<PathBuf>, BaselineError> {
        let run = RunFolder::open(path)?;
        let step = find(&run, which)?;
        Ok(vec![run.config_file(), run.weights(step)])
    }

    /// The files that it takes beside [`TrainedModel::files`] to open the model in a copy of its run.
    ///
    /// # Errors
    ///
    /// There is no run, or no such checkpoint.
    pub fn companions(path: &Path, which: Which) -> Result<Vec<PathBuf>, BaselineError> {
        let run = RunFolder::open(path)?;
        descriptions(&run, find(&run, which)?, which)
    }
}

/// The descriptions that lead to the checkpoint at `step`: its own, and of the best one that of the last, which names it.
pub(crate) fn descriptions(run: &RunFolder, step: u64, which: Which) -> Result<Vec<PathBuf>, BaselineError> {
    let mut steps = vec![step];
    if which == Which::Best {
        steps.extend(run.steps()?.last().filter(|last| **last != step));
    }
    Ok(steps.into_iter().map(|step| run.description(step)).collect())
}

pub(super) fn find(run: &RunFolder, which: Which) -> Result<u64, BaselineError> {
    step_of(run, which, |last| Ok(run.checkpoint::<State>(last)?.state.best))
}

/// The step of a checkpoint that is there; `best` tells the best one that the last knows.
///
/// # Errors
///
/// There is no checkpoint, not this one, or none that was validated.
pub fn step_of(
    run: &RunFolder,
    which: Which,
    best: impl FnOnce(u64) -> Result<Option<(u64, f64)>, BaselineError>,
) -> Result<u64, BaselineError> {
    let steps = run.steps()?;
    let Some(&last) = steps.last() else {
        return Err(run.wrong("it has no checkpoint yet; train longer, or with a smaller `checkpoint_every`"));
    };
    let wanted = match which {
        Which::Last => last,
        Which::Best => {
            let missing = || run.wrong("nothing validated it; use checkpoint=last");
            best(last)?.map(|(step, _)| step).ok_or_else(missing)?
        }
        Which::Step(step) => step,
    };
    match steps.contains(&wanted) {
        true => Ok(wanted),
        false => Err(run.wrong(format!("it has no checkpoint at step {wanted}; it has {steps:?}"))),
    }
}
