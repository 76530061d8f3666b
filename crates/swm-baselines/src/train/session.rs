//! A training run, new or resumed, from dataset to checkpoints.

use std::path::Path;

use serde_json::Value as Json;
use swm_core::{Cancel, Registry};
use swm_data::{Dataset, Loader};

use super::checkpoints::Checkpoint;
use super::data::{DataConfig, Split, TrainData, data_dims, with_images};
use super::diagnosis::Diagnosis;
use super::fit::{State, fit, totals};
use super::folder::{RunFolder, RunLock};
use super::looks::ImageLooks;
use super::metrics::{JsonLines, MetricSink, TensorBoard};
use super::run::{Origin, RunConfig, TrainedModel, Which, find};
use super::settings::FitSettings;
use super::world::FrozenWorld;
use crate::baseline::{Baseline, ModelConfig};
use crate::data::DataDims;
use crate::device::Device;
use crate::error::BaselineError;
use crate::models::gc_idm;
use crate::models::table::{MakeOptions, changed_settings, make, restore};

/// What a new run is made from.
#[derive(Clone, Debug)]
pub struct NewRun<'a> {
    /// A line of [`crate::BASELINES`].
    pub baseline: &'a str,
    /// `paper` or `small`.
    pub preset: &'a str,
    /// Settings of the baseline that differ from the preset's, as nested objects; `null` for none.
    pub changes: Json,
    /// The run with whose weights it begins: with its model, whose settings `changes` are laid over, and how its vectors are scaled. Then there
    /// is no preset and no encoder.
    pub from: Option<&'a Path>,
    /// Weights of another's encoder to begin with, where the baseline takes them: a file, or the folder of a run, whose last
    /// checkpoint is taken.
    pub encoder: Option<&'a Path>,
    /// How images are rendered, where these are others than the dataset holds.
    pub looks: ImageLooks,
    /// Which episodes train and validate.
    pub split: Split,
    /// How long, and how often it is looked at.
    pub fit: FitSettings,
    /// What it is computed on: no part of the run, which may go on elsewhere.
    pub device: Device,
}

/// A new run that is checked and not written yet.
pub struct PreparedRun {
    model: Box<dyn Baseline>,
    data: TrainData,
    config: RunConfig,
}

/// A training that is ready to run. It holds the run's folder until it is dropped.
pub struct Training {
    run: RunFolder,
    _lock: RunLock,
    model: Box<dyn Baseline>,
    data: TrainData,
    config: RunConfig,
}

impl PreparedRun {
    /// Makes the model and opens its clips. Images that the dataset does not hold are rendered when they are read, in the model's
    /// size, by the environment that it was recorded in, which `registry` knows.
    ///
    /// # Errors
    ///
    /// Settings that do not go together, a dataset that lacks what the model needs, or an encoder that cannot be read.
    pub fn new(registry: &Registry, dataset: &dyn Dataset, new: &NewRun<'_>) -> Result<Self, BaselineError> {
        let &NewRun { baseline, ref looks, split, ref fit, .. } = new;
        fit.check()?;
        let dims = data_dims(dataset, baseline)?;
        let Beginning { model, scales, from } = match new.from {
            Some(run) => Beginning::with_weights_of(run, dims, new)?,
            None => Beginning::fresh(dims, new)?,
        };
        check_looks(model.as_ref(), looks)?;
        let dataset = with_images(dataset, registry, baseline, model.input_spec().image, looks)?;
        let mut data =
            TrainData::new(dataset.as_ref(), baseline, model.input_spec(), model.phases(), split, fit.seed)?;
        if let Some(scales) = &scales {
            data.take_scales(scales);
        }
        data.config.looks.clone_from(looks);
        let mut fit = fit.clone();
        if fit.batch == 0 {
            fit.batch = model.input_spec().batch;
        }
        let model_config = model.model_config().clone();
        let config = RunConfig { fit, from, ..RunConfig::new(model_config, data.config.clone()) };
        Ok(Self { model, data, config })
    }

    /// The model, with its initial weights.
    pub fn model(&self) -> &dyn Baseline {
        self.model.as_ref()
    }

    /// What the run's `config.json` will say.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Writes the run in `folder`, which must hold none.
    ///
    /// # Errors
    ///
    /// A run is there already, or the folder cannot be written.
    pub fn create(self, folder: &Path) -> Result<Training, BaselineError> {
        let Self { model, data, config } = self;
        let (run, lock) = RunFolder::create(folder, &config)?;
        Ok(Training { _lock: lock, run, model, data, config })
    }
}

/// A model before its first step.
struct Beginning {
    model: Box<dyn Baseline>,
    /// What says how its vectors are scaled, where it is not the dataset.
    scales: Option<DataConfig>,
    from: Option<Origin>,
}

impl Beginning {
    /// A model with random weights, but for those of an encoder.
    fn fresh(dims: DataDims, new: &NewRun<'_>) -> Result<Self, BaselineError> {
        let &NewRun { baseline, preset, ref changes, encoder, ref fit, device, .. } = new;
        let world = (baseline == gc_idm::NAME).then(|| FrozenWorld::of(encoder, gc_idm::NAME)).transpose()?;
        let changes = world.as_ref().map_or_else(|| changes.clone(), |world| world.within(changes));
        let options = MakeOptions { preset, changes, dims, seed: fit.seed, device };
        let mut model = make(baseline, &options)?;
        match world.as_ref().map(|world| world.weights.as_path()).or(encoder) {
            Some(run) if run.is_dir() => model.load_encoder(&TrainedModel::files(run, Which::Last)?[1])?,
            Some(weights) => model.load_encoder(weights)?,
            None if model.has_frozen_encoder() => {
                return Err(BaselineError::Settings {
                    baseline: model.name(),
                    reason:
                        "its encoder is not trained, and would be random; name its weights as `encoder`: a file, such as \
                             facebook/dinov2-small for dino-wm, or a run, such as one of gcsl for keypoint-wm"
                            .to_owned(),
                });
            }
            None => {}
        }
        Ok(Self { model, scales: world.map(|world| world.data), from: None })
    }

    /// The model of the last checkpoint of a run.
    fn with_weights_of(path: &Path, dims: DataDims, new: &NewRun<'_>) -> Result<Self, BaselineError> {
        let run = RunFolder::open(path)?;
        let RunConfig { model_config: known, data, .. } = RunConfig::read(&run)?;
        if known.baseline != new.baseline {
            return Err(run.wrong(format!(
                "it trained {}, and {} is asked for; leave that out, or name another run",
                known.baseline, new.baseline
            )));
        }
        let checkpoint: Checkpoint<State> = run.checkpoint(find(&run, Which::Last)?)?;
        let settings = changed_settings(&known, &new.changes)?;
        let had = known.dims;
        let model_config = ModelConfig { settings, seed: new.fit.seed, ..known };
        let mut model = restore(&model_config, new.device)?;
        let differs = |what: &str, had: usize, found: usize| {
            run.wrong(format!("its model takes {what} of {had} values, and the dataset has {found}; use a dataset of that environment"))
        };
        if had.action_dim != dims.action_dim {
            return Err(differs("actions", had.action_dim, dims.action_dim));
        }
        if model.input_spec().proprio && had.proprio_dim != dims.proprio_dim {
            return Err(differs("`proprio`", had.proprio_dim, dims.proprio_dim));
        }
        model.load_weights(&run.checked_weights(&checkpoint)?)?;
        let from = Origin { run: path.to_owned(), step: checkpoint.step, weights: checkpoint.weights };
        Ok(Self { model, scales: Some(data), from: Some(from) })
    }
}

/// Refuses pairs of looks for what does not learn from them, and none for what does.
fn check_looks(model: &dyn Baseline, looks: &ImageLooks) -> Result<(), BaselineError> {
    let reason = match (model.learns_canonical(), looks.canonical.is_some()) {
        (true, false) => {
            "it learns from pairs of images, and the second look is not named; name factors of the canonical look and their \
             values, such as a black `background.color`"
        }
        (false, true) => "it learns from no images of a canonical look; leave it out, or train `canonical`",
        _ => return Ok(()),
    };
    let name = model.name();
    Err(BaselineError::Training { setting: "canonical".to_owned(), reason: format!("{name}: {reason}") })
}

impl Training {
    /// A new run in `folder`, which must hold none.
    ///
    /// # Errors
    ///
    /// As of [`PreparedRun::new`] and [`PreparedRun::create`].
    pub fn create(
        registry: &Registry,
        folder: &Path,
        dataset: &dyn Dataset,
        new: &NewRun<'_>,
    ) -> Result<Self, BaselineError> {
        PreparedRun::new(registry, dataset, new)?.create(folder)
    }

    /// Resumes the run in `folder`, on the dataset that it was begun with, which may have `moved` to another place and is of a format of `registry`. `change`
    /// may alter how long it shall go on; what it has learnt so far stays.
    ///
    /// # Errors
    ///
    /// There is no run, another process trains in it, its dataset is gone or another, or `change` altered what must
    /// stay.
    pub fn resume(
        registry: &Registry,
        folder: &Path,
        device: Device,
        moved: Option<&Path>,
        change: impl FnOnce(&mut FitSettings),
    ) -> Result<Self, BaselineError> {
        let run = RunFolder::open(folder)?;
        let lock = run.lock()?;
        let known = RunConfig::read(&run)?;
        if known.imported.is_some() {
            return Err(
                run.wrong("it was imported, and what its optimizers remember is not known; begin a new run with its weights: name it as `from_run`")
            );
        }
        let mut config = known.clone();
        change(&mut config.fit);
        config.fit.check()?;
        let FitSettings { batch, seed, .. } = known.fit;
        if (batch, seed) != (config.fit.batch, config.fit.seed) {
            return Err(
                run.wrong("batch and seed are those that it was begun with; make a new run to change them")
            );
        }
        if let Some(moved) = moved {
            config.data.path = moved.to_owned();
        }
        let dataset =
            swm_data::open_with(registry, &config.data.path, &config.data.opening).map_err(|error| {
                run.wrong(format!(
                    "its dataset is not there: {error}; bring it back, or name its place as `dataset`"
                ))
            })?;
        let model = restore(&config.model_config, device)?;
        known.check_model(&run, model.as_ref())?;
        let name = model.name();
        let looks = &config.data.looks;
        let dataset = with_images(dataset.as_ref(), registry, name, model.input_spec().image, looks)?;
        let mut data = TrainData::new(
            dataset.as_ref(),
            name,
            model.input_spec(),
            model.phases(),
            config.data.split,
            seed,
        )?;
        data.config.looks.clone_from(looks);
        // Those of the run that it began with, or of its encoder's.
        if known.from.is_some() || model.has_scales_of_its_encoder() {
            data.take_scales(&known.data);
        }
        // Earlier versions did not record them.
        if config.data.env_settings.is_none() {
            config.data.env_settings.clone_from(&data.config.env_settings);
            config.data.frame_skip = data.config.frame_skip;
        }
        let sample = data.config.sample.clone().filter(|_| config.data.sample.is_some());
        let found = DataConfig { sample, ..data.config.clone() };
        if found != config.data {
            let path = config.data.path.display();
            return Err(
                run.wrong(format!("{path} is not the dataset that it was begun with; bring that one back, or name its place as `dataset`"))
            );
        }
        if (known.fit.epochs, known.fit.steps) != (config.fit.epochs, config.fit.steps) {
            run.check_longer(totals(&data, &config.fit, model.as_ref()).iter().sum())?;
        }
        if known != config {
            run.write_config(&config)?;
        }
        Ok(Self { run, _lock: lock, model, data, config })
    }

    /// The model.
    pub fn model(&self) -> &dyn Baseline {
        self.model.as_ref()
    }

    /// What the run's `config.json` says.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Optimizer steps before the last checkpoint.
    ///
    /// # Errors
    ///
    /// The run's folder cannot be read.
    pub fn done(&self) -> Result<u64, BaselineError> {
        Ok(self.run.steps()?.last().copied().unwrap_or(0))
    }

    /// Optimizer steps of all phases.
    pub fn total(&self) -> u64 {
        totals(&self.data, &self.config.fit, self.model.as_ref()).iter().sum()
    }

    /// Clips to learn from and to validate with, in each phase.
    pub fn clips(&self) -> Vec<[usize; 2]> {
        let count =
            |clips: &super::PhaseClips| [clips.train.len(), clips.validation.as_ref().map_or(0, Loader::len)];
        self.data.phases.iter().map(count).collect()
    }

    /// Trains to the end, and returns where that was. Records go to the run's folder and to `sinks`.
    ///
    /// # Errors
    ///
    /// As of [`fit`].
    pub fn run(&mut self, sinks: Vec<Box<dyn MetricSink + '_>>) -> Result<State, BaselineError> {
        self.run_with(sinks, None, &Cancel::new())
    }

    /// As [`Training::run`], with the model measured by `diagnosis` on its way. Once `cancel` is set, the step at work is the
    /// last one, and a checkpoint follows it.
    ///
    /// # Errors
    ///
    /// As of [`fit`].
    pub fn run_with(
        &mut self,
        sinks: Vec<Box<dyn MetricSink + '_>>,
        diagnosis: Option<&mut (dyn Diagnosis + '_)>,
        cancel: &Cancel,
    ) -> Result<State, BaselineError> {
        let Self { run, model, data, config, .. } = self;
        let from = run.steps()?.last().copied();
        let mut all: Vec<Box<dyn MetricSink + '_>> =
            vec![Box::new(JsonLines::after(run, from.unwrap_or(0))?), Box::new(TensorBoard::new(run, from))];
        all.extend(sinks);
        fit(run, model.as_mut(), data, &config.fit, &mut all, diagnosis, cancel)
    }
}
