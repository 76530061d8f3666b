//! A trained goal-conditioned policy: from observation and goal to a block of actions, which it executes.

use swm_core::{Actions, Policy, PolicyError, Space, View};
use swm_solvers::{ActionMap, ActionScale};

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
    decisions: Vec<f32>,
}

/// What one environment is still to do.
#[derive(Clone, Debug, Default)]
struct Queue {
    episode: Option<u64>,
    /// `[F, A]`, of which `taken` values are executed.
    actions: Vec<f32>,
    taken: usize,
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
        let (map, rows, wanting, decisions) = (None, Vec::new(), Vec::new(), Vec::new());
        Ok(Self { model, policy, table, map, rows, wanting, decisions })
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
        format!("{}:step={step},weights={}", baseline.name(), weights.get(..12).unwrap_or(weights))
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.prepare(actions.space())?;
        let Self { policy, table, map, rows, wanting, decisions, .. } = self;
        let (_, map) = map.as_ref().expect("prepared above");
        rows.resize_with(view.rows(), Queue::default);
        wanting.clear();
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
            }
        }
        if !wanting.is_empty() {
            let block = policy.block_dim();
            decisions.clear();
            decisions.resize(wanting.len() * block, 0.0);
            policy.act(&table.batch(), decisions).map_err(other)?;
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
