//! What the goal of an episode looks like: the simulation goes there, and returns to where the episode stands.

use swm_core::EpisodeSeed;

use super::TableEnv;
use crate::inputs::finite_values;
use crate::ogbench::columns::observation;
use crate::ogbench::sim_state::{Goal, Observed, SimState};
use crate::ogbench::start;
use crate::views::GoalImage;
use swm_mujoco::MujocoError;

impl TableEnv {
    /// Finds out what the goal looks like: everything where it belongs, or as it was recorded; then returns to the start.
    pub(super) fn visit_goal(
        &mut self,
        recorded: Option<Vec<f64>>,
        observed: Option<Observed>,
    ) -> Result<(), MujocoError> {
        let is_late = self.table.is_late();
        self.sim_state = match observed {
            Some(observed) => SimState::recorded(&mut self.sim, &self.table.robot, observed, is_late)?,
            None => SimState::at_rest(&self.sim),
        };
        let start = self.task_state.clone();
        let has_settled = recorded.is_none();
        match recorded {
            Some(qpos) => {
                self.sim.qpos_mut().copy_from_slice(&qpos);
                self.sim.qvel_mut().fill(0.0);
                self.task_state.buttons = self.task_state.goal_buttons;
            }
            None => start::place_at_goal(&self.table, &mut self.sim, &mut self.task_state, &self.fov)?,
        }
        self.sim.forward()?;
        self.apply_buttons(self.task_state.buttons)?;
        let mut goal = Goal { sim_state: SimState::at_rest(&self.sim), ..Goal::default() };
        if has_settled {
            let stream = EpisodeSeed::new(self.task_state.seed as u64);
            for step in 0..2 {
                let action = self.spec.action.sample(&mut stream.indexed("goal action", [step, 0]));
                let values = finite_values(action.data.as_slice(), 5).ok();
                let values = values.and_then(|values| values.first_chunk().copied()).unwrap_or_default();
                self.table.robot.command(&mut self.sim, values);
                goal.sim_state.advance(&mut self.sim)?;
            }
            self.apply_buttons(self.task_state.buttons)?;
        }
        goal.buttons = self.task_state.buttons;
        observation(&self.table, &self.sim, &self.task_state, &mut goal.observation);
        (self.goal, self.task_state) = (goal, start);
        GoalImage::renew(&mut self.goal_image);
        self.stand()
    }

    /// Returns the simulation to where the episode stands.
    pub(super) fn stand(&mut self) -> Result<(), MujocoError> {
        let (sim_state, before) = (self.sim_state.clone(), self.task_state.before_buttons);
        self.stand_at(&sim_state, before, self.task_state.buttons)
    }

    /// Takes the simulation to a task_state: buttons stood `before` its last step, and stand as `buttons` after it.
    fn stand_at(
        &mut self,
        sim_state: &SimState,
        before: [u8; 2],
        buttons: [u8; 2],
    ) -> Result<(), MujocoError> {
        if let Some(furniture) = &self.table.furniture {
            furniture.show_states(self.sim.model_mut(), before, &self.lock_colors);
        }
        sim_state.restore(&mut self.sim)?;
        self.apply_buttons(buttons)?;
        sim_state.finish(&mut self.sim, &self.table.robot, self.table.is_late())
    }

    /// Renders the goal, and returns to where the episode is.
    pub(super) fn render_goal(&mut self, pixels: &mut [u8]) -> Result<(), MujocoError> {
        let goal = self.goal.clone();
        self.stand_at(&goal.sim_state, goal.buttons, goal.buttons)?;
        if let Some(images) = &mut self.images {
            images.render(&mut self.sim, pixels);
        }
        self.stand()
    }
}
