//! The world model that LeWM and PLDM share: one vector per image, and a predictor that actions steer. What sets them
//! apart is the loss.

mod planner;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::InputSpec;
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::auxiliary::Auxiliary;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::settings::check_sizes;
use swm_nn::Pass;
use swm_nn::{ActionEmbedder, CnnConfig, Mlp, Predictor, PredictorConfig, VitConfig};

pub(crate) use planner::JointPlanner;

/// Its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct JointConfig {
    /// The side of images.
    pub image: usize,
    /// What looks at them.
    pub encoder: EncoderConfig,
    /// Dim of a latent.
    #[serde(alias = "width")]
    pub latent_dim: usize,
    /// Hidden dim of the projectors after encoder and predictor.
    pub projector: usize,
    /// What predicts.
    pub predictor: PredictorConfig,
    /// How many states it sees.
    pub history: usize,
    /// Environment steps from one state to the next.
    pub frameskip: usize,
    /// Dim of the first layer of the action embedding.
    pub smoothed: usize,
    /// Clips of a batch.
    pub batch: usize,
}

impl JointConfig {
    /// The paper's: ViT-tiny on images of 224 pixels.
    pub fn paper() -> Self {
        Self {
            image: 224,
            encoder: EncoderConfig::Vit(VitConfig::default()),
            latent_dim: 192,
            projector: 2048,
            predictor: PredictorConfig::default(),
            history: 3,
            frameskip: 5,
            smoothed: 10,
            batch: 128,
        }
    }

    /// For a CPU: convolutions on images of 64 pixels.
    pub fn small() -> Self {
        let predictor = PredictorConfig { depth: 4, heads: 4, head_dim: 32, hidden: 512, dropout: 0.1 };
        Self {
            image: 64,
            encoder: EncoderConfig::Cnn(CnnConfig::default()),
            latent_dim: 128,
            projector: 512,
            predictor,
            batch: 64,
            ..Self::paper()
        }
    }

    fn check(&self) -> Result<(), String> {
        let positive = [
            ("image", self.image),
            ("latent_dim", self.latent_dim),
            ("projector", self.projector),
            ("history", self.history),
            ("frameskip", self.frameskip),
            ("smoothed", self.smoothed),
            ("batch", self.batch),
            ("predictor.heads", self.predictor.heads),
            ("predictor.head_dim", self.predictor.head_dim),
        ];
        check_sizes(&positive, self.predictor.dropout)?;
        self.encoder.check(self.image)
    }

    /// What the model is fed with: clips that hold as many predictions on end as `auxiliary` asks for.
    pub(crate) fn input_spec(&self, auxiliary: &Auxiliary) -> InputSpec {
        let &Self { image, history, frameskip, batch, .. } = self;
        let num_steps = history.max(auxiliary.steps()) + 1;
        InputSpec { num_steps, frameskip, image, proprio: false, batch }
    }

    /// The form of its tensors.
    pub(crate) fn form(&self, dims: &DataDims) -> Form {
        Form::new(self.image, self.frameskip * dims.action_dim, 0)
    }
}

/// Encoder, embedder of actions, predictor, and a projector after the first and the last.
#[derive(Module, Debug)]
pub(crate) struct Joint {
    encoder: Encoder,
    projector: Mlp,
    action_encoder: ActionEmbedder,
    predictor: Predictor,
    pred_proj: Mlp,
    #[module(skip)]
    config: JointConfig,
    #[module(skip)]
    form: Form,
}

/// States of a batch, and what was predicted of them.
pub(crate) struct Predicted {
    /// `[B, T, W]`: encoded.
    pub(crate) states: Tensor<3>,
    /// `[B, P, W]`: predicted for the P after the first, at most as many as the model sees states.
    pub(crate) predicted: Tensor<3>,
    /// `[B, T, 2 K]`: the places that states are made of, if the encoder finds any.
    pub(crate) places: Option<Tensor<3>>,
}

impl Joint {
    /// A network of zeros.
    pub(crate) fn new(
        baseline: &'static str,
        config: &JointConfig,
        dims: &DataDims,
        device: &Device,
    ) -> Result<Self, BaselineError> {
        config.check().map_err(|reason| BaselineError::Settings { baseline, reason })?;
        let &JointConfig { image, latent_dim, projector, history, smoothed, .. } = config;
        let form = config.form(dims);
        Ok(Self {
            encoder: Encoder::of_summaries(&config.encoder, image, latent_dim, device),
            projector: Mlp::new(config.encoder.summary_dim(latent_dim), projector, latent_dim, device),
            action_encoder: ActionEmbedder::new(form.action, smoothed, latent_dim, device),
            predictor: Predictor::new(&config.predictor, latent_dim, history, device),
            pred_proj: Mlp::new(latent_dim, projector, latent_dim, device),
            config: config.clone(),
            form,
        })
    }

    /// `[B, T, 3, S, S]` → `[B, T, W]`.
    pub(crate) fn encode(&self, pixels: Tensor<5>, pass: &mut Pass) -> Tensor<3> {
        self.projector.forward_frames(self.encoder.summaries(pixels), pass)
    }

    /// States and embedded actions `[B, T, W]` → the states after them.
    pub(crate) fn predict(&self, states: Tensor<3>, actions: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        self.pred_proj.forward_frames(self.predictor.forward(states, actions, pass), pass)
    }

    /// Encodes a batch, and predicts each of its states from the true ones before it.
    pub(crate) fn predict_batch(&self, inputs: &Inputs, pass: &mut Pass) -> Predicted {
        let (summaries, places) = self.encoder.summaries_and_places(inputs.pixels.clone());
        let states = self.projector.forward_frames(summaries, pass);
        let actions = self.action_encoder.forward(inputs.action.clone());
        let seen = (states.dims()[1] - 1).min(self.config.history);
        let predicted = self.predict(states.clone().narrow(1, 0, seen), actions.narrow(1, 0, seen), pass);
        Predicted { states, predicted, places }
    }

    /// Predicts `[B, R, W]` on end from states `[B, 1, W]` under actions `[B, R, D]`, as plans are predicted from one frame.
    /// Batch normalization does not remember it.
    pub(crate) fn roll_out(&self, first: Tensor<3>, actions: Tensor<3>, pass: &mut Pass) -> Tensor<3> {
        let actions = self.action_encoder.forward(actions);
        let mut states = vec![first];
        for end in 1..=actions.dims()[1] {
            let start = end.saturating_sub(self.config.history);
            let window = Tensor::cat(states[start..end].to_vec(), 1);
            let next = self.predictor.forward(window, actions.clone().narrow(1, start, end - start), pass);
            let next = next.narrow(1, end - start - 1, 1);
            states.push(pass.untold(|pass| self.pred_proj.forward_frames(next, pass)));
        }
        Tensor::cat(states.split_off(1), 1)
    }
}
