//! Plans that a policy over latents proposes: it acts on what the world model predicts of its own actions.

use super::cost::described;
use super::planning::PlanningTable;
use crate::baseline::{LatentPolicy, PlanModel};
use crate::data::Observations;
use crate::error::BaselineError;
use crate::train::TrainedModel;

/// A policy over the latents of the model of a plan.
pub(super) struct Proposal {
    policy: Box<dyn LatentPolicy>,
    name: String,
    latents: Vec<f32>,
    goals: Vec<f32>,
    actions: Vec<f32>,
}

impl Proposal {
    /// The policy of `trained`, for plans on `model`.
    pub(super) fn new(trained: &TrainedModel, model: &TrainedModel) -> Result<Self, BaselineError> {
        let baseline = trained.baseline.as_ref();
        let unfit = |reason| Err(BaselineError::Unfit { baseline: baseline.name(), reason });
        let Some(policy) = baseline.latent_policy() else {
            return unfit("proposes no plans; give a run of gc-idm as the proposal");
        };
        let settings = &baseline.model_config().settings;
        if settings.pointer("/model/world/weights").and_then(|hash| hash.as_str()) != Some(&model.weights) {
            return unfit(
                "learned over the latents of another world model, or of another checkpoint of this one; train it with this run as its \
                 encoder",
            );
        }
        if baseline.input_spec().frameskip != model.baseline.input_spec().frameskip {
            return unfit(
                "decides for blocks of other than the world model's actions; train it with `model.frameskip` at 0",
            );
        }
        let name = described(baseline.name(), trained.step, &trained.weights);
        Ok(Self { policy, name, latents: Vec::new(), goals: Vec::new(), actions: Vec::new() })
    }

    /// Which it is.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Fills the plans of `rows` in `initial`, `[B, H, D]`, for the problems of `table`, which are those rows in their order.
    pub(super) fn plan(
        &mut self,
        model: &mut dyn PlanModel,
        table: &PlanningTable,
        rows: &[usize],
        horizon: usize,
        initial: &mut [f32],
    ) -> Result<(), BaselineError> {
        let Self { policy, latents, goals, actions, .. } = self;
        let (dim, block) = (policy.latent_dim(), policy.block_dim());
        for (seen, latents) in table.present_and_goals().iter().zip([&mut *latents, &mut *goals]) {
            latents.clear();
            latents.resize(rows.len() * dim, 0.0);
            model.encode(&Observations { pixels: seen.pixels(), proprio: seen.proprio() }, latents)?;
        }
        actions.resize(rows.len() * block, 0.0);
        for step in 0..horizon {
            let left = vec![(horizon - step).min(policy.horizon()); rows.len()];
            policy.act(latents, goals, &left, actions)?;
            for (&row, action) in rows.iter().zip(actions.chunks_exact(block)) {
                initial[(row * horizon + step) * block..][..block].copy_from_slice(action);
            }
            if step + 1 < horizon {
                model.predict(latents, actions)?;
            }
        }
        Ok(())
    }
}
