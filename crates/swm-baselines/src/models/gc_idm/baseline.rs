//! The network and its world model as one baseline: batches of images are encoded, and weights are those of both.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::Device as TensorDevice;

use super::actor::{OverImages, OverLatents, single};
use super::{GcIdm, GcIdmConfig, NAME, make};
use crate::baseline::{
    Baseline, GoalPolicy, InputSpec, LatentPolicy, Losses, ModelConfig, Phase, PlanModel, Step,
};
use crate::data::{ClipBatch, DataDims, Images, Vectors};
use crate::error::BaselineError;
use crate::learner::Learner;
use crate::models::lewm;
use crate::models::table::{made_on, settings_of};
use crate::precision::Precision;
use crate::weights;
use swm_weights::Stored;

/// What the names of the world model's tensors begin with.
const WORLD: &str = "world.";
/// Latents of more values are encoded with each batch: those of a whole dataset would not fit into memory.
const MOST_LATENT: usize = 4096;

struct IdmBaseline {
    learner: Learner<GcIdm>,
    world: Box<dyn Baseline>,
    /// The world model at work; `None` until it is needed, and once its weights change.
    encoder: RefCell<Option<Box<dyn PlanModel>>>,
    /// Z and D.
    dims: [usize; 2],
}

/// A baseline of these settings, its weights and those of its world model still random.
pub(crate) fn baseline(
    config: &GcIdmConfig,
    model_config: ModelConfig,
    device: &TensorDevice,
) -> Result<Box<dyn Baseline>, BaselineError> {
    let wrong = |reason: String| BaselineError::Settings { baseline: NAME, reason };
    let dims = model_config.dims;
    let of_world = match &config.model.world {
        Some(world) => world.model_config.clone(),
        None => ModelConfig {
            baseline: lewm::NAME.to_owned(),
            preset: "small".to_owned(),
            settings: settings_of(lewm::NAME, "small")?,
            dims,
            seed: 0,
        },
    };
    let DataDims { action_dim, proprio_dim } = of_world.dims;
    if action_dim != dims.action_dim {
        return Err(wrong(format!(
            "actions of its world model have {action_dim} values, and those of the data {}; take a world model of the same actions",
            dims.action_dim
        )));
    }
    let world = made_on(&of_world, device)?;
    let Some(encoder) = world.planner() else {
        return Err(wrong(format!(
            "{} is no world model and has no latents; take a run of one, such as of lewm",
            world.name()
        )));
    };
    if world.input_spec().proprio && proprio_dim != dims.proprio_dim {
        return Err(wrong(format!(
            "its world model sees a `proprio` of {proprio_dim} values, and the data has {}; take data with that column",
            dims.proprio_dim
        )));
    }
    let latent = encoder.latent_dim();
    let parts = make(config, world.input_spec(), [latent, dims.action_dim], device)?;
    let dims = [latent, parts.form.action];
    let learner = Learner::new(NAME, model_config, parts, device.clone())?;
    Ok(Box::new(IdmBaseline { learner, world, encoder: RefCell::new(Some(encoder)), dims }))
}

impl IdmBaseline {
    /// Calls `work` with the batch as latents, which are encoded unless it holds them already.
    fn over_latents<R>(
        world: &dyn Baseline,
        encoder: &RefCell<Option<Box<dyn PlanModel>>>,
        batch: &ClipBatch<'_>,
        work: impl FnOnce(&ClipBatch<'_>) -> Result<R, BaselineError>,
    ) -> Result<R, BaselineError> {
        let &ClipBatch { pixels, latents, action, ref proprio, .. } = batch;
        let Images { rows, steps, .. } = pixels;
        let without = |latents| ClipBatch {
            pixels: Images { values: &[], rows, steps, height: 0, width: 0, channels_last: false },
            latents: Some(latents),
            canonical: None,
            action,
            proprio: None,
            goal_pixels: None,
            goal_proprio: None,
        };
        if let Some(latents) = latents {
            return work(&without(latents));
        }
        let mut encoder = encoder.borrow_mut();
        let encoder =
            encoder.get_or_insert_with(|| world.planner().expect("there was one when this was made"));
        let dim = encoder.latent_dim();
        let mut values = vec![0.0; rows * steps * dim];
        encoder.encode(&single(&pixels, proprio.as_ref()), &mut values)?;
        work(&without(Vectors { values: &values, rows, steps, dim }))
    }

    fn actor(&self) -> OverLatents {
        OverLatents { network: self.learner.computing(), dims: self.dims }
    }
}

/// The tensors of a file of both: those of the network, and those of the world model.
type Halves = [BTreeMap<String, Stored>; 2];

fn halves(path: &Path) -> Result<Halves, BaselineError> {
    let mut halves = Halves::default();
    for (name, tensor) in swm_weights::read(path)? {
        match name.strip_prefix(WORLD) {
            Some(inner) => halves[1].insert(inner.to_owned(), tensor),
            None => halves[0].insert(name, tensor),
        };
    }
    Ok(halves)
}

/// Files of a moment.
fn scratch(path: &Path) -> Result<tempfile::TempDir, BaselineError> {
    let folder =
        path.parent().filter(|parent| parent.is_dir()).map_or_else(tempfile::tempdir, tempfile::tempdir_in);
    folder.or_else(|_| tempfile::tempdir()).map_err(|source| BaselineError::Io {
        action: "make a folder for",
        path: path.to_owned(),
        source,
    })
}

fn written(tensors: BTreeMap<String, Stored>, prefix: &str) -> Vec<(String, Vec<usize>, Vec<f32>)> {
    let each =
        tensors.into_iter().map(|(name, tensor)| (format!("{prefix}{name}"), tensor.shape, tensor.values));
    each.collect()
}

impl Baseline for IdmBaseline {
    fn name(&self) -> &'static str {
        NAME
    }

    fn model_config(&self) -> &ModelConfig {
        self.learner.model_config()
    }

    fn input_spec(&self) -> &InputSpec {
        self.learner.input_spec()
    }

    fn phases(&self) -> &[Phase] {
        self.learner.phases()
    }

    fn parameters(&self) -> usize {
        self.learner.parameters()
    }

    fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        let of_world =
            self.world.tensors().into_iter().map(|(name, shape)| (format!("{WORLD}{name}"), shape));
        self.learner.tensors().into_iter().chain(of_world).collect()
    }

    fn has_frozen_encoder(&self) -> bool {
        true
    }

    fn trains_on_latents(&self) -> bool {
        self.dims[0] <= MOST_LATENT
    }

    fn latent_encoder(&self) -> Option<Box<dyn PlanModel>> {
        self.world.planner()
    }

    fn has_scales_of_its_encoder(&self) -> bool {
        true
    }

    fn set_precision(&mut self, precision: Precision) {
        // Images are encoded once, and in fp32.
        self.learner.set_precision(precision);
    }

    fn train_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Losses, BaselineError> {
        let Self { learner, world, encoder, .. } = self;
        Self::over_latents(world.as_ref(), encoder, batch, |batch| learner.train_step(batch, at))
    }

    fn start_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Option<Losses>, BaselineError> {
        let Self { learner, world, encoder, .. } = self;
        Self::over_latents(world.as_ref(), encoder, batch, |batch| learner.start_step(batch, at))
    }

    fn take_losses(&mut self) -> Result<Vec<Losses>, BaselineError> {
        self.learner.take_losses()
    }

    fn validate(&self, batch: &ClipBatch<'_>, phase: usize) -> Result<Losses, BaselineError> {
        let Self { learner, world, encoder, .. } = self;
        Self::over_latents(world.as_ref(), encoder, batch, |batch| learner.validate(batch, phase))
    }

    fn save_weights(&self, path: &Path) -> Result<(), BaselineError> {
        let folder = scratch(path)?;
        let part = |name: &str| folder.path().join(name);
        self.learner.save_weights(&part("network"))?;
        self.world.save_weights(&part("world"))?;
        let mut tensors = written(swm_weights::read(&part("network"))?, "");
        tensors.extend(written(swm_weights::read(&part("world"))?, WORLD));
        Ok(swm_weights::write(path, tensors)?)
    }

    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError> {
        let [own, of_world] = halves(path)?;
        let network = weights::load_stored(self.learner.network(), path, own)?;
        let folder = scratch(&std::env::temp_dir().join("world"))?;
        let part = folder.path().join("world");
        swm_weights::write(&part, written(of_world, ""))?;
        self.load_encoder(&part)?;
        self.learner.replace(network);
        Ok(())
    }

    fn load_encoder(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.world.load_weights(path)?;
        self.encoder.take();
        Ok(())
    }

    fn save_training(&self, path: &Path) -> Result<(), BaselineError> {
        self.learner.save_training(path)
    }

    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.learner.load_training(path)
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        None
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        let encoder = self.world.planner()?;
        Some(Box::new(OverImages { encoder, policy: self.actor(), latents: [Vec::new(), Vec::new()] }))
    }

    fn latent_policy(&self) -> Option<Box<dyn LatentPolicy>> {
        Some(Box::new(self.actor()))
    }
}
