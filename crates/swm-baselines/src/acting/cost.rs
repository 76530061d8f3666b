//! A trained world model as the cost of plans: how far from the goal the model says a plan ends.

use serde_json::{Map, Value as Json, json};
use swm_solvers::{
    ActionScale, Aggregate, Candidates, Cost, Outputs, PlanError, PlanningContext, StateSteps, StepBatch,
};

use super::canonical::{CANONICAL, canonicalizer};
use super::planning::PlanningTable;
use super::proposal::Proposal;
use crate::baseline::{Baseline, Canonicalizer, PlanModel};
use crate::data::Observations;
use crate::error::BaselineError;
use crate::train::{ACTION, TrainedModel};

/// Plans on a world model's predictions, in the units of the actions that it was trained with.
///
/// Episodes that are too young for a full history are planned for with what they have: environments are grouped by
/// the frames they can show, each group by a copy of the model. A candidate's cost has the same bits in any company.
pub struct ModelCost {
    model: TrainedModel,
    aggregate: Aggregate,
    /// What plans begin from.
    proposal: Option<Proposal>,
    /// What draws its images in the canonical look, if anything does, and which it is.
    canonical: Option<(Box<dyn Canonicalizer>, String)>,
    /// By the number of frames, from 1.
    copies: Vec<Copy>,
}

/// The setting that says how costs are made: its name is that of planners on the true dynamics.
pub const AGGREGATE: &str = "aggregate";

/// A copy of the model and the environments that it plans for.
struct Copy {
    model: Box<dyn PlanModel>,
    table: PlanningTable,
    /// Their indices in the planning context.
    rows: Vec<usize>,
    actions: Vec<f32>,
    costs: Vec<f64>,
    gradient: Vec<f32>,
}

impl ModelCost {
    /// Costs of plans as `model` predicts them.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Unfit`]: the model predicts nothing.
    pub fn new(model: TrainedModel) -> Result<Self, BaselineError> {
        let Some(planner) = model.baseline.planner() else {
            let reason = "is no world model and predicts nothing; act with it: `policy:RUN`";
            return Err(BaselineError::Unfit { baseline: model.baseline.name(), reason });
        };
        let aggregate = Aggregate::default();
        let mut cost = Self { model, aggregate, proposal: None, canonical: None, copies: Vec::new() };
        cost.copies.push(cost.copy(planner));
        Ok(cost)
    }

    /// With the cost of a plan made of the distances of all its predicted states from the goal, as `aggregate` says.
    #[must_use]
    pub fn with_aggregate(mut self, aggregate: Aggregate) -> Self {
        self.aggregate = aggregate;
        self.copies.iter_mut().for_each(|copy| copy.model.set_aggregate(aggregate));
        self
    }

    /// With plans that a policy over the model's latents proposes, at which searches begin.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Unfit`]: it is no such policy, or one over the latents of another model.
    pub fn with_proposal(mut self, policy: &TrainedModel) -> Result<Self, BaselineError> {
        self.proposal = Some(Proposal::new(policy, &self.model)?);
        Ok(self)
    }

    /// With observations and goals that `canonical` draws in the canonical look before the model sees them.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Unfit`]: it draws no images.
    pub fn with_canonical(mut self, canonical: &TrainedModel) -> Result<Self, BaselineError> {
        self.canonical = Some(canonicalizer(canonical)?);
        let planner = |this: &Self| this.model.baseline.planner().expect("there was one when this was made");
        self.copies = vec![self.copy(planner(&self))];
        Ok(self)
    }

    /// How actions are scaled in plans.
    pub fn action_scale(&self) -> ActionScale {
        let scale = &self.model.config.data.scales[ACTION];
        ActionScale::MeanStd { mean: scale.mean.clone(), std: scale.std.clone() }
    }

    /// Settings of the plan, unless others are given.
    pub fn plan_settings(&self) -> Map<String, Json> {
        self.model.baseline.plan_settings()
    }

    /// Actions of a block: the model's frame skip.
    pub fn action_block(&self) -> usize {
        self.model.baseline.input_spec().frameskip
    }

    fn copy(&self, mut model: Box<dyn PlanModel>) -> Copy {
        model.set_aggregate(self.aggregate);
        let baseline: &dyn Baseline = self.model.baseline.as_ref();
        let canonical = self.canonical.as_ref().map(|(canonicalizer, _)| canonicalizer.share());
        let table = PlanningTable::new(baseline, &self.model.config.data).with_canonical(canonical);
        let (rows, actions, costs, gradient) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Copy { model, table, rows, actions, costs, gradient }
    }

    /// Sees that there are copies for 1 to `frames` observations.
    fn copies_for(&mut self, frames: usize) {
        while self.copies.len() < frames {
            let model = self.model.baseline.planner().expect("there was one when this was made");
            self.copies.push(self.copy(model));
        }
    }

    /// The most observations that the model makes use of.
    pub fn history(&self) -> usize {
        self.copies[0].model.history().max(1)
    }
}

impl Cost for ModelCost {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let (block, longest) = (self.action_block(), self.history());
        let frames_of = |index| context.history(index).map_or(1, |past| past.frames().min(longest));
        self.copies_for((0..context.len()).map(frames_of).max().unwrap_or(1));
        for (frames, copy) in (1..).zip(&mut self.copies) {
            copy.rows.clear();
            copy.table.clear(frames);
        }
        for index in 0..context.len() {
            let frames = frames_of(index);
            let Copy { table, rows, .. } = &mut self.copies[frames - 1];
            if let Some(past) = context.history(index) {
                let skipped = past.frames() - frames;
                for frame in skipped..past.frames() - 1 {
                    table.push_past(|field| past.frame(field, frame))?;
                }
                for action in skipped * block..(past.frames() - 1) * block {
                    table.push_action(past.action(action));
                }
            }
            table.push(context.env(index).row)?;
            rows.push(index);
        }
        for copy in self.copies.iter_mut().filter(|copy| !copy.rows.is_empty()) {
            copy.table.finish()?;
            copy.model.prepare(&copy.table.batch())?;
        }
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let (samples, size) = (candidates.samples, candidates.horizon * candidates.dim);
        let per_row = samples * size;
        for copy in self.copies.iter_mut().filter(|copy| !copy.rows.is_empty()) {
            // All environments in one group is the rule: nothing is copied then.
            if copy.rows.len() == candidates.episodes {
                copy.model.evaluate(candidates, outputs)?;
                continue;
            }
            let Copy { model, rows, actions, costs, gradient, .. } = copy;
            actions.clear();
            for &row in &*rows {
                actions.extend_from_slice(&candidates.actions[row * per_row..][..per_row]);
            }
            costs.resize(rows.len() * samples, 0.0);
            gradient.resize(actions.len(), 0.0);
            let group = Candidates { actions, episodes: rows.len(), ..*candidates };
            let wanted = outputs.gradient.is_some().then_some(&mut gradient[..]);
            model.evaluate(&group, &mut Outputs { gradient: wanted, ..Outputs::new(costs) })?;
            for (&row, own) in rows.iter().zip(costs.chunks_exact(samples)) {
                outputs.costs[row * samples..][..samples].copy_from_slice(own);
            }
            if let Some(all) = &mut outputs.gradient {
                for (&row, own) in rows.iter().zip(gradient.chunks_exact(per_row)) {
                    all[row * per_row..][..per_row].copy_from_slice(own);
                }
            }
        }
        Ok(())
    }

    fn propose(&mut self, horizon: usize, initial: &mut [f32]) -> Result<bool, PlanError> {
        let Self { proposal: Some(proposal), copies, .. } = self else { return Ok(false) };
        for Copy { model, table, rows, .. } in copies.iter_mut().filter(|copy| !copy.rows.is_empty()) {
            proposal.plan(model.as_mut(), table, rows, horizon, initial)?;
        }
        Ok(true)
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn steps(&mut self) -> Option<&mut dyn StateSteps> {
        Some(self)
    }

    fn history_fields(&self) -> Vec<String> {
        self.copies[0].table.fields()
    }

    /// Name, step and the beginning of the weights' hash; how costs are made, if not of the last state.
    fn changed_settings(&self) -> Map<String, Json> {
        let TrainedModel { baseline, step, weights, .. } = &self.model;
        let model = described(baseline.name(), *step, weights);
        let mut settings = Map::from_iter([("model".to_owned(), model.into())]);
        if let Some(proposal) = &self.proposal {
            settings.insert("proposal".to_owned(), proposal.name().into());
        }
        if let Some((_, name)) = &self.canonical {
            settings.insert(CANONICAL.to_owned(), name.clone().into());
        }
        if self.aggregate != Aggregate::default() {
            settings.insert(AGGREGATE.to_owned(), json!(self.aggregate));
        }
        settings
    }
}

/// A checkpoint by name, step and the beginning of the weights' hash.
pub(super) fn described(name: &str, step: u64, weights: &str) -> String {
    format!("{name}@{step}#{}", weights.get(..12).unwrap_or(weights))
}

/// Latents are the states: of the newest observation, and of the goal. A step sees nothing of what was before.
impl StateSteps for ModelCost {
    fn state_dim(&mut self) -> usize {
        self.copies[0].model.latent_dim()
    }

    fn ends(&mut self, starts: &mut [f32], goals: &mut [f32]) -> Result<(), PlanError> {
        let dim = self.state_dim();
        let mut latents = Vec::new();
        for Copy { model, table, rows, .. } in self.copies.iter_mut().filter(|copy| !copy.rows.is_empty()) {
            for (seen, out) in table.present_and_goals().iter().zip([&mut *starts, &mut *goals]) {
                latents.clear();
                latents.resize(rows.len() * dim, 0.0);
                let seen = Observations { pixels: seen.pixels(), proprio: seen.proprio() };
                model.encode(&seen, &mut latents)?;
                for (&row, latent) in rows.iter().zip(latents.chunks_exact(dim)) {
                    out[row * dim..][..dim].copy_from_slice(latent);
                }
            }
        }
        Ok(())
    }

    fn step_toward(
        &mut self,
        steps: &StepBatch<'_>,
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        let StepBatch { candidates, states, targets } = steps;
        Ok(self.copies[0].model.step_toward(states, candidates.actions, targets, next, gradient)?)
    }
}
