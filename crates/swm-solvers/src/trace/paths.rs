//! What a plan leads to, by simulating it.

use swm_core::env::step_times;
use swm_core::error::BoxError;
use swm_core::{Column, Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvState, Place};
use swm_solvers::ActionMap;

/// An environment to try plans in.
pub(super) struct Future<'a> {
    env: Box<dyn Env>,
    actions: &'a ActionMap,
    action: Column,
    frame_skip: u32,
    /// Whether the planner's roll-outs end at the environment's success.
    stops_at_success: bool,
    /// Height and width of the images that paths are rendered over.
    pub(super) size: Option<[usize; 2]>,
}

impl<'a> Future<'a> {
    pub(super) fn new(
        entry: &EnvEntry,
        config: &EnvConfig,
        actions: &'a ActionMap,
        frame_skip: u32,
        stops_at_success: bool,
    ) -> Result<Self, BoxError> {
        let size = config.image.map(|image| [image.height, image.width]);
        let env = entry.make(&EnvConfig { image: None, ..config.clone() })?;
        let space = &env.spec().action;
        let action = Column::zeros(space.dtype().unwrap_or(Dtype::F32), space.dim());
        Ok(Self { env, actions, action, frame_skip, stops_at_success, size })
    }

    /// Names of the dimensions of an action: `action[0]`.
    pub(super) fn action_names(&self) -> Vec<String> {
        match self.action.len() {
            1 => vec!["action".to_owned()],
            dim => (0..dim).map(|index| format!("action[{index}]")).collect(),
        }
    }

    /// Where objects are, at `start` and after every action of `plan`, `[H × k, A]`, as far as the planner's roll-outs went.
    pub(super) fn places(&mut self, start: &EnvState, plan: &[f32]) -> Result<Vec<Vec<Place>>, BoxError> {
        self.env.restore(start)?;
        let mut all = vec![self.env.places()];
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
            all.push(self.env.places());
            // An end without success, such as a fall, stays an end.
            if outcome.terminated && (self.stops_at_success || outcome.success != Some(true)) {
                break;
            }
        }
        Ok(all)
    }
}
