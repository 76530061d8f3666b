//! What a folder of `models/` provides: a network with losses. [`Learner`](crate::learner) makes a [`Baseline`] of it.
//!
//! [`Baseline`]: crate::Baseline

use burn::module::Module;
use serde_json::{Map, Value as Json};

use crate::baseline::{Canonicalizer, GoalPolicy, InputSpec, Phase, PlanModel};
use crate::data::{Form, Inputs};
use crate::error::BaselineError;
use swm_nn::Background;
use swm_nn::Pass;
use swm_nn::losses::Terms;

/// A network that can be trained.
pub(crate) trait Network: Module + 'static {
    /// What the names of the encoder's tensors begin with.
    const ENCODER: &'static str = "encoder";

    /// What the names of tensors begin with that neither plans nor actions need: files of others may lack them.
    const DISPENSABLE: &'static [&'static str] = &[];

    /// Whether the loss can be had from the latents of a frozen encoder: of [`Inputs::latents`] as of [`Inputs::pixels`].
    const TRAINS_ON_LATENTS: bool = false;

    /// Whether the loss needs [`Inputs::canonical`].
    const LEARNS_CANONICAL: bool = false;

    /// The network before its first step, with the statistics of the data that it keeps.
    fn begin(self, inputs: &Inputs) -> Self {
        Background::find(self, &inputs.pixels)
    }

    /// The loss of a phase.
    fn loss(&self, phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError>;

    /// The model at work as a world model.
    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        None
    }

    /// See [`Baseline::plan_settings`](crate::Baseline::plan_settings).
    fn plan_settings(&self) -> Map<String, Json> {
        Map::new()
    }

    /// The model at work as what draws images in the canonical look; they are standardized as `form` has it.
    fn canonicalizer(&self, _form: &Form) -> Option<Box<dyn Canonicalizer>> {
        None
    }

    /// The model at work as a policy.
    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        None
    }
}

/// What a model's folder hands to the learner.
pub(crate) struct Parts<N> {
    /// The network, its weights still zeros.
    pub(crate) network: N,
    /// The input that it takes.
    pub(crate) input_spec: InputSpec,
    /// The form of its tensors.
    pub(crate) form: Form,
    /// How it is trained.
    pub(crate) phases: Vec<Phase>,
}
