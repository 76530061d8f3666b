//! What the goal-conditioned policies share: observing, acting, and the extraction of a policy from a value.

mod policy;
mod transition;
mod value_learner;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use swm_data::loader::GoalWeights;

use crate::baseline::{InputSpec, Phase, PhaseGoals};
use crate::data::{DataDims, Form, Inputs};
use crate::error::BaselineError;
use crate::models::encoder::{Encoder, EncoderConfig};
use crate::models::gcivl::PolicyGoals;
use crate::models::settings::check_sizes;
use swm_nn::optim::OptimConfig;
use swm_nn::{CnnConfig, GoalTransformerConfig, Pool, StateEmbedder, TokenForm, VitConfig};

pub(crate) use policy::ActingPolicy;
pub(crate) use transition::Transition;
pub(crate) use value_learner::ValueLearner;

/// How they see and how large they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct GoalConfig {
    /// The side of images.
    pub image: usize,
    /// What looks at them.
    pub encoder: EncoderConfig,
    /// Whether it is trained; otherwise its weights are another's: give them before training.
    pub train_encoder: bool,
    /// Embedding dim of `proprio`; 0: it is not used.
    pub proprio: usize,
    /// Policy, value and critic.
    pub predictor: GoalTransformerConfig,
    /// How many observations they see.
    pub history: usize,
    /// Environment steps from one observation to the next; a decision is so many actions.
    pub frameskip: usize,
    /// Clips of a batch.
    pub batch: usize,
    /// γ of goals that are drawn geometrically: 1 / (1 - γ) decisions ahead on average, and at most at the end of the
    /// episode. A goal k decisions ahead is γ times as likely as one k - 1 ahead.
    #[serde(default = "goal_gamma")]
    pub goal_gamma: f64,
}

fn goal_gamma() -> f64 {
    0.99
}

impl GoalConfig {
    /// The reference's: a frozen DINOv2-small.
    pub fn paper() -> Self {
        Self {
            image: 224,
            encoder: EncoderConfig::Vit(VitConfig::dinov2_small()),
            train_encoder: false,
            proprio: 0,
            predictor: GoalTransformerConfig::default(),
            history: 3,
            frameskip: 1,
            batch: 128,
            goal_gamma: goal_gamma(),
        }
    }

    /// For a CPU: convolutions that are trained, on images of 64 pixels.
    pub fn small() -> Self {
        Self {
            image: 64,
            encoder: EncoderConfig::Cnn(CnnConfig::default()),
            train_encoder: true,
            proprio: 0,
            predictor: GoalTransformerConfig {
                depth: 3,
                heads: 4,
                head_dim: 32,
                hidden: 256,
                dropout: 0.0,
                pool: Pool::Mean,
                compare: false,
            },
            history: 1,
            frameskip: 5,
            batch: 64,
            goal_gamma: goal_gamma(),
        }
    }

    /// As [`Self::small`], for learners of values.
    pub fn small_with_value() -> Self {
        let small = Self::small();
        Self { predictor: GoalTransformerConfig { compare: true, ..small.predictor }, ..small }
    }

    fn check(&self) -> Result<(), String> {
        let positive = [
            ("image", self.image),
            ("history", self.history),
            ("frameskip", self.frameskip),
            ("batch", self.batch),
            ("predictor.depth", self.predictor.depth),
            ("predictor.heads", self.predictor.heads),
            ("predictor.head_dim", self.predictor.head_dim),
        ];
        check_sizes(&positive, self.predictor.dropout)?;
        if !(0.0..1.0).contains(&self.goal_gamma) {
            return Err(format!(
                "`model.goal_gamma` is {}; use a number from 0 up to, but not, 1",
                self.goal_gamma
            ));
        }
        self.encoder.check(self.image)
    }

    /// The model's input: its history and so many steps more.
    pub(crate) fn input_spec(&self, more: usize) -> InputSpec {
        InputSpec {
            num_steps: self.history + more,
            frameskip: self.frameskip,
            image: self.image,
            proprio: self.proprio > 0,
            batch: self.batch,
        }
    }

    /// The form of its tensors.
    pub(crate) fn form(&self, dims: &DataDims) -> Form {
        let proprio = if self.proprio > 0 { dims.proprio_dim } else { 0 };
        Form::new(self.image, self.frameskip * dims.action_dim, proprio)
    }

    /// The form of what transformers see.
    pub(crate) fn tokens(&self) -> TokenForm {
        let [patches, dim] = self.encoder.tokens(self.image);
        TokenForm { patches, frames: self.history, dim: dim + self.proprio }
    }

    /// What values and critics look with: as the policy, but for the mean of a frame's tokens.
    pub(crate) fn value_transformer(&self) -> GoalTransformerConfig {
        GoalTransformerConfig { pool: Pool::Mean, ..self.predictor.clone() }
    }

    /// The phase that extracts a policy from the learned value, for such goals.
    pub(crate) fn policy_phase(&self, optim: &OptimConfig, goals: PolicyGoals) -> Phase {
        Phase {
            name: "policy",
            optim: optim.clone(),
            goals: self.goals(goals.weights()),
            trains: &["action_predictor", "log_stds"],
            targets: &[],
            momentum: 0.0,
        }
    }

    /// Goals of clips, seen from the last step of the history.
    pub(crate) fn goals(&self, weights: GoalWeights) -> Option<PhaseGoals> {
        Some(PhaseGoals { weights, gamma: self.goal_gamma, offset: self.history })
    }
}

/// Tokens of frames and goals: an encoder, and proprioception concatenated to every token.
#[derive(Module, Debug)]
pub(crate) struct Observer {
    encoder: Encoder,
    proprio: Option<StateEmbedder>,
}

/// What was seen of a batch.
pub(crate) struct Seen {
    /// `[B, T, P, W]`.
    pub(crate) frames: Tensor<4>,
    /// `[B, 1, P, W]`.
    pub(crate) goal: Tensor<4>,
}

impl Observer {
    /// A network of zeros.
    pub(crate) fn new(
        baseline: &'static str,
        config: &GoalConfig,
        dims: &DataDims,
        device: &Device,
    ) -> Result<Self, BaselineError> {
        let wrong = |reason| BaselineError::Settings { baseline, reason };
        config.check().map_err(wrong)?;
        if config.proprio > 0 && dims.proprio_dim == 0 {
            return Err(wrong("`proprio` is on and the data has none; set it to 0".to_owned()));
        }
        let embedder = || StateEmbedder::new(dims.proprio_dim, config.proprio, device);
        Ok(Self {
            encoder: Encoder::of_tokens(&config.encoder, config.image, device),
            proprio: (config.proprio > 0).then(embedder),
        })
    }

    /// `[B, T, P, W]` of images `[B, T, 3, S, S]` and proprioception `[B, T, …]`.
    pub(crate) fn tokens(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<4> {
        let tokens = self.encoder.tokens(pixels);
        match (&self.proprio, proprio) {
            (Some(embedder), Some(proprio)) => concatenate(tokens, embedder.forward(proprio)),
            _ => tokens,
        }
    }

    /// All frames of a batch, and its goals.
    pub(crate) fn see(&self, inputs: &Inputs) -> Result<Seen, BaselineError> {
        let Some(goal) = inputs.goal_pixels.clone() else {
            let reason = "this model needs goals: load clips with goal options";
            return Err(BaselineError::data("goal_pixels", reason));
        };
        Ok(Seen {
            frames: self.tokens(inputs.pixels.clone(), inputs.proprio.clone()),
            goal: self.tokens(goal, inputs.goal_proprio.clone()),
        })
    }
}

/// Concatenates `[B, T, E]` to each of the tokens `[B, T, P, W]`: `[B, T, P, W + E]`.
pub(crate) fn concatenate(tokens: Tensor<4>, state: Tensor<3>) -> Tensor<4> {
    let [batch, frames, patches, _] = tokens.dims();
    let dim = state.dims()[2];
    let tiled = state.unsqueeze_dim::<4>(2).expand([batch, frames, patches, dim]);
    Tensor::cat(vec![tokens, tiled], 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_goals_are_a_setting() {
        let weights = GoalWeights { random: 0.0, geometric: 1.0, uniform: 0.0, current: 0.0 };
        let gamma = |config: &GoalConfig| config.goals(weights).expect("goals").gamma;
        let small = GoalConfig::small();
        assert_eq!((gamma(&small), gamma(&GoalConfig { goal_gamma: 0.8, ..small.clone() })), (0.99, 0.8));
        // Settings that were written before it existed.
        let mut old = serde_json::to_value(&small).unwrap();
        old.as_object_mut().unwrap().remove("goal_gamma").unwrap();
        assert_eq!(serde_json::from_value::<GoalConfig>(old).unwrap(), small);
        for wrong in [1.0, -0.1, f64::NAN] {
            let refused = GoalConfig { goal_gamma: wrong, ..small.clone() }.check().unwrap_err();
            assert!(refused.contains("model.goal_gamma"), "{refused}");
        }
    }

    #[test]
    fn extracted_policies_can_have_near_goals() {
        let config = GoalConfig { goal_gamma: 0.8, ..GoalConfig::small_with_value() };
        let goals = |kind| config.policy_phase(&OptimConfig::default(), kind).goals.expect("goals");
        let (mixed, near) = (goals(PolicyGoals::default()), goals(PolicyGoals::Geometric));
        assert_eq!((mixed.weights.random, mixed.weights.uniform, mixed.weights.geometric), (0.5, 0.5, 0.0));
        assert_eq!((near.weights.geometric, near.gamma), (1.0, 0.8));
    }
}
