//! A trained goal-conditioned policy: from observation and goal to a block of actions, which it executes.

use swm_core::{Actions, Policy, PolicyError, Space, View};
use swm_solvers::{ActionMap, ActionScale};

use super::canonical::canonicalizer;
use super::planning::PlanningTable;
use crate::baseline::GoalPolicy;
use crate::error::BaselineError;
use crate::train::{ACTION, TrainedModel};

/// Acts as the model says, one observation at a time. Every decision belongs to its environment alone.
pub struct ModelPolicy {
    model: TrainedModel,
    policy: Box<dyn GoalPolicy>,
    table: PlanningTable,
    /// From the model's values to actions of the last requested space.
    map: Option<(Space, ActionMap)>,
    rows: Vec<Queue>,
    /// Environments that need a decision.
    wanting: Vec<usize>,
    /// Decisions that each of them has left.
    left: Vec<usize>,
    decisions: Vec<f32>,
    /// What draws its images in the canonical look, if anything does.
    canonical: Option<String>,
}

/// What one environment is still to do.
#[derive(Clone, Debug, Default)]
struct Queue {
    episode: Option<u64>,
    /// `[F, A]`, of which `taken` values are executed.
    actions: Vec<f32>,
    taken: usize,
    /// Decisions that were made in the episode.
    made: usize,
}

impl Queue {
    /// Counts a decision, and says how many are left to a policy of this horizon, the new one included: the horizon at first,
    /// then one less each time, and after the last the horizon again.
    fn decide(&mut self, horizon: usize) -> usize {
        let left = horizon - self.made % horizon.max(1);
        self.made += 1;
        left
    }
}

impl ModelPolicy {
    /// A policy that acts as `model` does.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Unfit`]: the model is no policy.
    pub fn new(model: TrainedModel) -> Result<Self, BaselineError> {
        let Some(policy) = model.baseline.policy() else {
            let reason = "does not act by itself; plan with it: `mpc:RUN`";
            return Err(BaselineError::Unfit { baseline: model.baseline.name(), reason });
        };
        let table = PlanningTable::new(model.baseline.as_ref(), &model.config.data);
        let (map, rows, wanting, left, decisions) = (None, Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Ok(Self { model, policy, table, map, rows, wanting, left, decisions, canonical: None })
    }

    /// With observations and goals that `canonical` draws in the canonical look before the model sees them.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Unfit`]: it draws no images.
    pub fn with_canonical(mut self, canonical: &TrainedModel) -> Result<Self, BaselineError> {
        let (canonicalizer, name) = canonicalizer(canonical)?;
        self.table = self.table.with_canonical(Some(canonicalizer));
        self.canonical = Some(name);
        Ok(self)
    }

    /// Prepares the mapping to actions of `space`.
    fn prepare(&mut self, space: &Space) -> Result<(), PolicyError> {
        if self.map.as_ref().is_none_or(|(known, _)| known != space) {
            let scale = &self.model.config.data.scales[ACTION];
            let scale = ActionScale::MeanStd { mean: scale.mean.clone(), std: scale.std.clone() };
            self.map = Some((space.clone(), ActionMap::scaled(space, &scale, true)?));
            self.rows.clear();
        }
        Ok(())
    }
}

impl Policy for ModelPolicy {
    fn describe(&self) -> String {
        let TrainedModel { baseline, step, weights, .. } = &self.model;
        let canonical = self.canonical.as_ref().map_or(String::new(), |name| format!(",canonical={name}"));
        format!("{}:step={step},weights={}{canonical}", baseline.name(), weights.get(..12).unwrap_or(weights))
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.prepare(actions.space())?;
        let Self { policy, table, map, rows, wanting, left, decisions, .. } = self;
        let (_, map) = map.as_ref().expect("prepared above");
        rows.resize_with(view.rows(), Queue::default);
        wanting.clear();
        left.clear();
        table.clear(1);
        for index in view.live() {
            let Some(live) = view.row(index) else { continue };
            let queue = &mut rows[index];
            if live.episode.step == 0 || queue.episode != Some(live.episode.index) {
                *queue = Queue { episode: Some(live.episode.index), ..Queue::default() };
            }
            if queue.taken == queue.actions.len() {
                table.push(live.row).map_err(other)?;
                wanting.push(index);
                left.push(queue.decide(policy.horizon()));
            }
        }
        if !wanting.is_empty() {
            let block = policy.block_dim();
            decisions.clear();
            decisions.resize(wanting.len() * block, 0.0);
            table.finish().map_err(other)?;
            policy.act_within(&table.batch(), left, decisions).map_err(other)?;
            for (&index, decision) in wanting.iter().zip(decisions.chunks_exact(block)) {
                rows[index].actions.clear();
                rows[index].actions.extend_from_slice(decision);
                rows[index].taken = 0;
            }
        }
        for index in view.live() {
            let queue = &mut rows[index];
            map.write(&queue.actions[queue.taken..][..map.dim()], &mut actions.row(index));
            queue.taken += map.dim();
        }
        Ok(())
    }
}

fn other(error: BaselineError) -> PolicyError {
    PolicyError::Other(Box::new(error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisions_that_are_left_are_counted_down_again_and_again() {
        let mut queue = Queue::default();
        assert_eq!([0; 7].map(|_| queue.decide(3)), [3, 2, 1, 3, 2, 1, 3]);
        let mut queue = Queue::default();
        assert_eq!([0; 3].map(|_| queue.decide(0)), [0; 3]);
    }
}
