//! A world model over keypoints: an MLP predicts, action by action, where the places go that a frozen encoder finds.
//!
//! As DINO-WM (arXiv 2411.04983) predicts the patch tokens of a frozen DINOv2. Here the encoder is one of places, such as `gcsl`
//! learns (`weights.drawing=1`), and gives so few values that the latents of a whole dataset fit into memory: each image is encoded
//! once, and a training sees millions of transitions in minutes. Not the reference's.
//!
//! A place tells no velocity; the last action does, where bodies come to rest as soon as nothing drives them. So the model
//! sees the last action, too: zeros where there is none. Of bodies that keep moving, such as arms, it sees with `model.velocity` how
//! the places have changed last.

mod planner;
#[cfg(test)]
mod tests;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};

use crate::baseline::{InputSpec, Phase, PlanModel};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use crate::plan::Planner;
use swm_nn::Pass;
use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::optim::OptimConfig;
use swm_nn::{KeypointConfig, Keypoints, LatentChange, LatentChangeSizes};

/// Its name.
pub(crate) const NAME: &str = "keypoint-wm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct KeypointWmConfig {
    /// The network.
    pub model: KeypointModelConfig,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// How it sees, and how large it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct KeypointModelConfig {
    /// The side of images, that of the encoder's training.
    pub image: usize,
    /// The frozen encoder: as it was trained.
    pub encoder: KeypointConfig,
    /// Values of a hidden layer.
    pub hidden: usize,
    /// Hidden layers.
    pub depth: usize,
    /// Whether it sees how places have changed last, which bodies that keep moving take.
    #[serde(default)]
    pub velocity: bool,
    /// How many latents are predicted on end in training.
    pub rollout_steps: usize,
    /// Environment steps from one latent to the next.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
}

impl KeypointWmConfig {
    /// Settings for a CPU: single actions, 2,048 transitions per step.
    pub fn small() -> Self {
        Self {
            model: KeypointModelConfig {
                image: 64,
                encoder: KeypointConfig::default(),
                hidden: 512,
                depth: 3,
                velocity: false,
                rollout_steps: 1,
                frameskip: 1,
                batch: 2048,
            },
            optim: OptimConfig { lr: 1e-3, weight_decay: 0.01, ..OptimConfig::default() },
        }
    }

    fn check(&self) -> Result<(), String> {
        let KeypointModelConfig {
            image,
            encoder,
            hidden,
            depth,
            rollout_steps,
            frameskip,
            batch,
            velocity: _,
        } = &self.model;
        let positive = [
            ("model.image", *image),
            ("model.hidden", *hidden),
            ("model.depth", *depth),
            ("model.rollout_steps", *rollout_steps),
            ("model.frameskip", *frameskip),
            ("model.batch", *batch),
        ];
        check_sizes(&positive, 0.0)?;
        Keypoints::check(encoder)
    }
}

#[derive(Module, Debug)]
struct KeypointWm {
    encoder: Encoder,
    predictor: LatentChange,
    #[module(skip)]
    form: Form,
    /// Z: values of a latent.
    #[module(skip)]
    dim: usize,
    #[module(skip)]
    velocity: bool,
    /// F: environment steps from one latent to the next.
    #[module(skip)]
    frameskip: usize,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &KeypointWmConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    config.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let &KeypointModelConfig { image, ref encoder, hidden, depth, velocity, rollout_steps, frameskip, batch } =
        &config.model;
    let form = Form::new(image, frameskip * dims.action_dim, 0);
    let dim = 2 * encoder.count;
    let sizes = LatentChangeSizes { latent: dim, action: form.action, velocity, hidden, depth };
    let network = KeypointWm {
        encoder: Encoder::of_tokens(&EncoderConfig::Keypoints(encoder.clone()), image, device),
        predictor: LatentChange::new(sizes, device),
        form,
        dim,
        velocity,
        frameskip,
    };
    // The action before the first latent is one of the clip's.
    let input_spec = InputSpec { num_steps: rollout_steps + 2, frameskip, image, proprio: false, batch };
    let phase = Phase::only(&config.optim, &["predictor"]);
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

impl KeypointWm {
    /// `[B, T, 3, S, S]` → `[B, T, Z]`.
    fn encode(&self, pixels: Tensor<5>) -> Tensor<3> {
        self.encoder.tokens(pixels).flatten::<3>(2, 3).detach()
    }

    /// `[B, T, Z]` of a batch that holds images, or them.
    fn latents(&self, inputs: &Inputs) -> Tensor<3> {
        inputs.latents.clone().unwrap_or_else(|| self.encode(inputs.pixels.clone()))
    }

    /// How latents have changed, `[N, Z]`, where the model sees that.
    fn changed(&self, from: &Tensor<2>, to: &Tensor<2>) -> Option<Tensor<2>> {
        self.velocity.then(|| to.clone() - from.clone())
    }

    /// Predicts on end from latents `[N, Z]`, after actions `[N, D]` and a change `[N, Z]`, under actions `[N, H, D]`: H latents
    /// `[N, Z]`.
    fn roll_out(
        &self,
        first: Tensor<2>,
        before: Tensor<2>,
        changed: Option<Tensor<2>>,
        actions: &Tensor<3>,
    ) -> Vec<Tensor<2>> {
        let (mut latents, mut before, mut changed) = (first, before, changed);
        let mut next = |step| {
            let after: Tensor<2> = actions.clone().narrow(1, step, 1).squeeze_dim(1);
            let now = latents.clone();
            latents = self.predictor.forward(now.clone(), before.clone(), after.clone(), changed.take());
            (before, changed) = (after, self.changed(&now, &latents));
            latents.clone()
        };
        (0..actions.dims()[1]).map(&mut next).collect()
    }
}

impl Network for KeypointWm {
    const TRAINS_ON_LATENTS: bool = true;

    fn begin(self, inputs: &Inputs) -> Self {
        let latents = self.latents(inputs);
        LatentChange::find(self, &latents)
    }

    /// The mean squared error of predictions, as a share of the mean square of what changes in one step: 1 if nothing is said to
    /// move.
    fn loss(&self, _phase: usize, inputs: &Inputs, _pass: &mut Pass) -> Result<Terms, BaselineError> {
        let latents = self.latents(inputs);
        let steps = latents.dims()[1] - 2;
        let of_step = |all: &Tensor<3>, step| all.clone().narrow(1, step, 1).squeeze_dim::<2>(1);
        let actions = inputs.action.clone().narrow(1, 1, steps);
        let changed = self.changed(&of_step(&latents, 0), &of_step(&latents, 1));
        let predicted = self.roll_out(of_step(&latents, 1), of_step(&inputs.action, 0), changed, &actions);
        let unit = self.predictor.mean_square_change();
        let error =
            |(step, predicted)| mean_squared_error(predicted, of_step(&latents, step + 2)) / unit.clone();
        let errors: Vec<Tensor<1>> = predicted.into_iter().enumerate().map(error).collect();
        let parts = match &errors[..] {
            [first, .., last] => vec![("first", first.clone()), ("last", last.clone())],
            _ => Vec::new(),
        };
        Ok(Terms { total: Tensor::cat(errors, 0).mean(), parts })
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(Planner::new(self.clone())))
    }

    /// As far as other models plan, of which 5 actions are executed; with the last action in sight.
    fn plan_settings(&self) -> Map<String, Json> {
        let blocks = |actions: usize| (actions / self.frameskip).max(1);
        let settings = json!({
            "horizon": blocks(25),
            "receding_horizon": blocks(5),
            "shrinking_horizon": true,
            "history_len": 2,
        });
        settings.as_object().cloned().unwrap_or_default()
    }
}
