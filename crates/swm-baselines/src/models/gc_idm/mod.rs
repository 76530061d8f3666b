//! Goal-conditioned inverse dynamics over the latents of a frozen world model (arXiv 2605.08732): from the latents of an observation and of
//! a goal, and from how many decisions are left, to the next block of actions, without any search.
//!
//! The world model is any that encodes single observations. Its config and weights are part of the run, so that a run acts by itself.
//! Training is that of GCSL over clips of latents, which are encoded once where they fit into memory
//! (`docs/design/0026-latents-encoded-once.md`).

mod actor;
mod baseline;
#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{InputSpec, ModelConfig, Phase};
use crate::data::{Form, Inputs};
use crate::error::BaselineError;
use crate::models::countdown::imitation;
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::optim::OptimConfig;
use swm_nn::{CountdownPredictor, CountdownSizes, LatentMoments, Looks};

pub(crate) use baseline::baseline;

/// Its name.
pub(crate) const NAME: &str = "gc-idm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GcIdmConfig {
    /// The network.
    pub model: IdmConfig,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// What it looks with, how large it is, and how far ahead its goals are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct IdmConfig {
    /// The frozen world model; `null`: a LeWM of the preset `small`. A training takes it from a run.
    pub world: Option<WorldConfig>,
    /// Dim of hidden layers.
    pub hidden: usize,
    /// Hidden layers.
    pub depth: usize,
    /// K: decisions to the farthest goals, in training and at work.
    pub horizon: usize,
    /// Environment steps from one decision to the next; 0: as the world model has it.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
}

/// A frozen world model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct WorldConfig {
    /// What it is.
    pub model_config: ModelConfig,
    /// SHA-256 of the weights of its run, by which plans on the same model are known.
    pub weights: String,
}

impl WorldConfig {
    /// The model of a run, whose weights have this hash.
    pub(crate) fn new(model_config: ModelConfig, weights: String) -> Self {
        // Its weights come from the run: the seed of its first ones means nothing.
        Self { model_config: ModelConfig { seed: 0, ..model_config }, weights }
    }
}

impl GcIdmConfig {
    /// Settings for a CPU: goals up to 5 decisions ahead, as those of the historic protocol are.
    pub fn small() -> Self {
        Self {
            model: IdmConfig { world: None, hidden: 512, depth: 3, horizon: 5, frameskip: 0, batch: 256 },
            optim: OptimConfig { lr: 1e-3, weight_decay: 0.01, ema: 0.999, ..OptimConfig::default() },
        }
    }

    fn check(&self) -> Result<(), String> {
        let IdmConfig { hidden, depth, horizon, batch, .. } = &self.model;
        let positive = [
            ("model.hidden", *hidden),
            ("model.depth", *depth),
            ("model.horizon", *horizon),
            ("model.batch", *batch),
        ];
        check_sizes(&positive, 0.0)
    }
}

#[derive(Module, Debug)]
pub(super) struct GcIdm {
    moments: LatentMoments,
    action_predictor: CountdownPredictor,
}

/// Network and training over latents of `latent_dim` values, whose images are those of `world`.
fn make(
    config: &GcIdmConfig,
    world: &InputSpec,
    [latent_dim, action_dim]: [usize; 2],
    device: &Device,
) -> Result<Parts<GcIdm>, BaselineError> {
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let &IdmConfig { hidden, depth, horizon, frameskip, batch, .. } = &config.model;
    let frameskip = if frameskip == 0 { world.frameskip } else { frameskip };
    let form = Form::new(world.image, frameskip * action_dim, 0);
    let sizes = CountdownSizes {
        inputs: latent_dim,
        normalizes: false,
        hidden,
        depth,
        outputs: form.action,
        horizon,
    };
    let network = GcIdm {
        moments: LatentMoments::new(latent_dim, device),
        action_predictor: CountdownPredictor::new(sizes, device),
    };
    let input_spec =
        InputSpec { num_steps: horizon + 1, frameskip, image: world.image, proprio: world.proprio, batch };
    let phase = Phase { name: "policy", ..Phase::only(&config.optim, &["action_predictor"]) };
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

impl GcIdm {
    /// The shares of latents `[B, T, Z]` in the first layer.
    fn look(&self, latents: Tensor<3>) -> Looks {
        self.action_predictor.look(self.moments.forward(latents).unsqueeze_dim(2))
    }
}

impl Network for GcIdm {
    const TRAINS_ON_LATENTS: bool = true;

    fn begin(self, inputs: &Inputs) -> Self {
        let latents = inputs.latents.clone().expect("every batch of it holds latents");
        LatentMoments::find(self, &latents)
    }

    fn loss(&self, _phase: usize, inputs: &Inputs, _pass: &mut Pass) -> Result<Terms, BaselineError> {
        let latents = inputs.latents.clone().expect("every batch of it holds latents");
        Ok(imitation(&self.action_predictor, self.look(latents), &inputs.action))
    }
}
