//! DINO-WM, which the reference calls PreJEPA: predicts the tokens of a frozen DINOv2, with actions and proprioception concatenated to
//! each (arXiv 2411.04983).
//!
//! Loss: squared error of all that is predicted but the actions' part; targets take part in no gradient.

mod planner;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::{InputSpec, Phase, PlanModel};
use crate::data::{DataDims, Form, Inputs, Normalization};
use crate::error::BaselineError;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::goal::concatenate;
use crate::models::settings::check_sizes;
use crate::network::{Network, Parts};
use crate::plan::Planner;
use swm_nn::Pass;
use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::optim::{OptimConfig, Schedule};
use swm_nn::{FramePredictor, PredictorConfig, StateEmbedder, TokenForm, VitConfig};

/// Its name.
pub(crate) const NAME: &str = "dino-wm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct DinoWmConfig {
    /// The side of images.
    pub image: usize,
    /// How their values are standardized.
    #[serde(default)]
    pub normalization: Normalization,
    /// What looks at them; it is not trained. Give its weights before training.
    pub encoder: EncoderConfig,
    /// Embedding dim of `proprio`; 0: it is not used.
    pub proprio: usize,
    /// Embedding dim of the actions of a step.
    pub action: usize,
    /// What predicts.
    pub predictor: PredictorConfig,
    /// How many frames it sees.
    pub history: usize,
    /// Environment steps from one frame to the next.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
    /// The optimizer.
    pub optim: OptimConfig,
}

impl DinoWmConfig {
    /// The paper's settings, with proprioception.
    pub fn paper() -> Self {
        Self {
            image: 224,
            normalization: Normalization::Imagenet,
            encoder: EncoderConfig::Vit(VitConfig::dinov2_small()),
            proprio: 10,
            action: 10,
            predictor: PredictorConfig::default(),
            history: 3,
            frameskip: 5,
            batch: 32,
            optim: OptimConfig {
                lr: 5e-4,
                weight_decay: 0.0,
                schedule: Schedule::COSINE,
                ..OptimConfig::default()
            },
        }
    }

    /// Settings for a CPU: the same encoder on images of 70 pixels, 25 tokens each, and a smaller predictor
    /// without proprioception.
    pub fn small() -> Self {
        Self {
            image: 70,
            proprio: 0,
            predictor: PredictorConfig { depth: 3, heads: 4, head_dim: 64, hidden: 512, dropout: 0.1 },
            batch: 16,
            ..Self::paper()
        }
    }

    fn check(&self, dims: &DataDims) -> Result<(), String> {
        let positive = [
            ("image", self.image),
            ("action", self.action),
            ("history", self.history),
            ("frameskip", self.frameskip),
            ("batch", self.batch),
            ("predictor.heads", self.predictor.heads),
            ("predictor.head_dim", self.predictor.head_dim),
        ];
        check_sizes(&positive, self.predictor.dropout)?;
        if self.proprio > 0 && dims.proprio_dim == 0 {
            return Err("`proprio` is on and the data has none; set it to 0".to_owned());
        }
        self.encoder.check(self.image)
    }

    fn form(&self, dims: &DataDims) -> Form {
        let proprio = if self.proprio > 0 { dims.proprio_dim } else { 0 };
        Form {
            normalization: self.normalization,
            ..Form::new(self.image, self.frameskip * dims.action_dim, proprio)
        }
    }
}

#[derive(Module, Debug)]
struct DinoWm {
    encoder: Encoder,
    predictor: FramePredictor,
    proprio: Option<StateEmbedder>,
    action: StateEmbedder,
    #[module(skip)]
    form: Form,
    #[module(skip)]
    history: usize,
    /// Patches, and dim of each, of an observation without actions.
    #[module(skip)]
    observed: [usize; 2],
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &DinoWmConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let (network, form) = network(config, dims, device)?;
    let &DinoWmConfig { image, proprio, history, frameskip, batch, .. } = config;
    let phase = Phase::only(&config.optim, &["predictor", "extra_encoders"]);
    let input_spec = InputSpec { num_steps: history + 1, frameskip, image, proprio: proprio > 0, batch };
    Ok(Parts { network, input_spec, form, phases: vec![phase] })
}

fn network(config: &DinoWmConfig, dims: &DataDims, device: &Device) -> Result<(DinoWm, Form), BaselineError> {
    config.check(dims).map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let form = config.form(dims);
    let [patches, dim] = config.encoder.tokens(config.image);
    let tokens = TokenForm { patches, frames: config.history, dim: dim + config.proprio + config.action };
    let proprio = || StateEmbedder::new(dims.proprio_dim, config.proprio, device);
    let network = DinoWm {
        encoder: Encoder::of_tokens(&config.encoder, config.image, device),
        predictor: FramePredictor::new(&config.predictor, &tokens, device),
        proprio: (config.proprio > 0).then(proprio),
        action: StateEmbedder::new(form.action, config.action, device),
        form,
        history: config.history,
        observed: [patches, dim + config.proprio],
    };
    Ok((network, form))
}

impl DinoWm {
    /// `[B, T, P, W]` without the actions' part.
    fn observe(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<4> {
        let tokens = self.encoder.tokens(pixels).detach();
        match (&self.proprio, proprio) {
            (Some(embedder), Some(proprio)) => concatenate(tokens, embedder.forward(proprio)),
            _ => tokens,
        }
    }

    /// Concatenates embedded actions `[B, T, D]` to observed or predicted tokens.
    fn with_actions(&self, tokens: Tensor<4>, actions: Tensor<3>) -> Tensor<4> {
        concatenate(tokens, self.action.forward(actions))
    }

    /// The next frame of each, without the actions' part.
    fn predict(&self, frames: Tensor<4>, pass: &mut Pass) -> Tensor<4> {
        let next = self.predictor.forward(frames, pass);
        let dim = next.dims()[3] - self.action.dim();
        next.narrow(3, 0, dim)
    }
}

impl Network for DinoWm {
    const ENCODER: &'static str = "backbone";

    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let observed = self.observe(inputs.pixels.clone(), inputs.proprio.clone());
        let seen = observed.dims()[1] - 1;
        let frames = self.with_actions(observed.clone(), inputs.action.clone()).narrow(1, 0, seen);
        let predicted = self.predict(frames, pass);
        let loss = mean_squared_error(predicted, observed.narrow(1, 1, seen).detach());
        Ok(Terms { total: loss, parts: Vec::new() })
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(Planner::new(self.clone())))
    }
}
