//! What plans lead to, by simulating them: where objects are in the image after every action, and the task cost at the end.

use swm_core::env::step_times;
use swm_core::error::BoxError;
use swm_core::{Column, Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvState, Keypoint, PolicyArgs};

use crate::context::ActionMap;

/// An environment to try plans in.
pub struct PlanPaths {
    env: Box<dyn Env>,
    actions: ActionMap,
    action: Column,
    frame_skip: u32,
    stops_at_success: bool,
}

impl PlanPaths {
    /// Makes an environment as `config` says, without images. `actions`: [`MpcPolicy::actions`](crate::MpcPolicy::actions) of the
    /// planner. `stops_at_success`: whether its roll-outs end at the environment's own success: [`stops_at_success`].
    ///
    /// # Errors
    ///
    /// Those of making the environment.
    pub fn new(
        entry: &EnvEntry,
        config: &EnvConfig,
        actions: ActionMap,
        frame_skip: u32,
        stops_at_success: bool,
    ) -> Result<Self, BoxError> {
        let env = entry.make(&EnvConfig { image: None, ..config.clone() })?;
        let space = &env.spec().action;
        let action = Column::zeros(space.dtype().unwrap_or(Dtype::F32), space.dim());
        Ok(Self { env, actions, action, frame_skip, stops_at_success })
    }

    /// How many values an action has.
    pub fn action_dim(&self) -> usize {
        self.action.len()
    }

    /// Keypoints at `start` and after every action of `plan`, `[H, D]`, as far as the planner's roll-outs went.
    ///
    /// # Errors
    ///
    /// The state is of another environment, or the simulation fails.
    pub fn keypoints(&mut self, start: &EnvState, plan: &[f32]) -> Result<Vec<Vec<Keypoint>>, BoxError> {
        self.env.restore(start)?;
        let mut all = vec![self.env.keypoints()];
        for values in plan.chunks_exact(self.actions.dim()) {
            self.actions.write(values, &mut self.action.as_slice_mut());
            if !self.action.as_slice().is_finite() {
                break;
            }
            let outcome = match step_times(self.env.as_mut(), self.action.as_slice(), self.frame_skip) {
                Ok(outcome) => outcome,
                Err(EnvError::Diverged { .. }) => break,
                Err(error) => return Err(error.into()),
            };
            all.push(self.env.keypoints());
            // An end without success, such as a fall, stays an end.
            if outcome.terminated && (self.stops_at_success || outcome.success != Some(true)) {
                break;
            }
        }
        Ok(all)
    }

    /// The task cost where the last plan ended; `None` in environments without one.
    pub fn task_cost(&self) -> Option<f64> {
        self.env.task_cost()
    }
}

impl std::fmt::Debug for PlanPaths {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PlanPaths").field("env", &self.env.spec().id).finish_non_exhaustive()
    }
}

/// Whether roll-outs of a planner with these arguments end at the environment's own success.
pub fn stops_at_success(args: &PolicyArgs) -> bool {
    args.named.get("stop_at_success").and_then(serde_json::Value::as_bool).unwrap_or(true)
}
