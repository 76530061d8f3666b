//! The world model that LeWM and PLDM share: one vector per image, and a predictor that actions steer. What sets them
//! apart is the loss.

mod planner;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use crate::baseline::Needs;
use crate::data::{Facts, Form, Inputs};
use crate::error::BaselineError;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::settings::check_sizes;
use crate::nn::{ActionEmbedder, CnnConfig, Mlp, Predictor, PredictorConfig, VitConfig};
use crate::pass::Pass;

pub(crate) use planner::JointPlanner;

/// Its size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointConfig {
    /// The side of images.
    pub image: usize,
    /// What looks at them.
    pub encoder: EncoderConfig,
    /// Numbers of a state.
    pub width: usize,
    /// Hidden numbers of the projectors after encoder and predictor.
    pub projector: usize,
    /// What predicts.
    pub predictor: PredictorConfig,
    /// How many states it sees.
    pub history: usize,
    /// Environment steps from one state to the next.
    pub frameskip: usize,
    /// Numbers that the actions of a step are brought to before they are embedded.
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
            width: 192,
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
        let predictor = PredictorConfig { depth: 4, heads: 4, head_width: 32, hidden: 512, dropout: 0.1 };
        Self {
            image: 64,
            encoder: EncoderConfig::Cnn(CnnConfig::default()),
            width: 128,
            projector: 512,
            predictor,
            batch: 64,
            ..Self::paper()
        }
    }

    fn check(&self) -> Result<(), String> {
        let positive = [
            ("image", self.image),
            ("width", self.width),
            ("projector", self.projector),
            ("history", self.history),
            ("frameskip", self.frameskip),
            ("smoothed", self.smoothed),
            ("batch", self.batch),
            ("predictor.heads", self.predictor.heads),
            ("predictor.head_width", self.predictor.head_width),
        ];
        check_sizes(&positive, self.predictor.dropout)?;
        self.encoder.check(self.image)
    }

    /// What the model is fed with.
    pub(crate) fn needs(&self) -> Needs {
        let &Self { image, history, frameskip, batch, .. } = self;
        Needs { num_steps: history + 1, frameskip, image, proprio: false, batch }
    }

    /// The form of its tensors.
    pub(crate) fn form(&self, facts: &Facts) -> Form {
        Form { image: self.image, action: self.frameskip * facts.action_width, proprio: 0 }
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
    /// `[B, T - 1, W]`: predicted for all but the first.
    pub(crate) predicted: Tensor<3>,
}

impl Joint {
    /// A network of zeros.
    pub(crate) fn new(
        baseline: &'static str,
        config: &JointConfig,
        facts: &Facts,
        device: &Device,
    ) -> Result<Self, BaselineError> {
        config.check().map_err(|reason| BaselineError::Settings { baseline, reason })?;
        let &JointConfig { image, width, projector, history, smoothed, .. } = config;
        let form = config.form(facts);
        Ok(Self {
            encoder: Encoder::of_summaries(&config.encoder, image, width, device),
            projector: Mlp::new(config.encoder.summary_width(width), projector, width, device),
            action_encoder: ActionEmbedder::new(form.action, smoothed, width, device),
            predictor: Predictor::new(&config.predictor, width, history, device),
            pred_proj: Mlp::new(width, projector, width, device),
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
        let states = self.encode(inputs.pixels.clone(), pass);
        let actions = self.action_encoder.forward(inputs.action.clone());
        let seen = states.dims()[1] - 1;
        let predicted = self.predict(states.clone().narrow(1, 0, seen), actions.narrow(1, 0, seen), pass);
        Predicted { states, predicted }
    }
}
