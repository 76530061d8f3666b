//! The simulator state that is needed to restore a simulation bit for bit, images included.
//!
//! After a control step OGBench reads and renders what was computed before the last physics step. So the task_state is the state
//! before that step, which is then repeated.

use serde::{Deserialize, Serialize};

use super::env::SUBSTEPS;
use super::pose;
use super::robot::{Effector, Robot};
use swm_mujoco::MujocoError;
use swm_mujoco::{JointKind, Simulation};

/// A simulator state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct SimState {
    /// The state, and behind it what a recorded row has besides: see [`Observed`].
    state: Vec<f64>,
    moment: Moment,
}

/// What the state is. Saved states have it as one byte, which was a truth value before there were recorded ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
enum Moment {
    /// The present one.
    #[default]
    AtRest,
    /// That before the last physics step.
    BeforeStep,
    /// The present one, of a recorded row: what is read and rendered belongs to that before.
    Recorded,
}

/// What a recorded row has besides the state, and what does not follow from it: it was computed before the last physics step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observed {
    pub(super) effector: Effector,
    /// See [`Robot::gripper_contact`].
    pub(super) contact: f64,
}

impl Observed {
    const DIM: usize = 5;
    /// The most that a recorded effector may be off where it was computed again, m: rounding.
    const NEAR: f64 = 1e-9;
}

/// What an episode should end like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Goal {
    pub(super) sim_state: SimState,
    /// The states of the buttons.
    pub(super) buttons: [u8; 2],
    pub(super) observation: Vec<f64>,
}

impl SimState {
    /// The present state, from which everything has been computed.
    pub(super) fn at_rest(sim: &Simulation) -> Self {
        let mut state = Vec::new();
        sim.save_state(&mut state);
        Self { state, moment: Moment::AtRest }
    }

    /// The present state, of a recorded row, whose effector is where `observed` has it; else as [`SimState::at_rest`]. Where
    /// `is_late`, what is read belongs to the state before the last physics step, which is found by going back along the
    /// velocities: but for rounding, where everything was then.
    pub(super) fn recorded(
        sim: &mut Simulation,
        robot: &Robot,
        observed: Observed,
        is_late: bool,
    ) -> Result<Self, MujocoError> {
        let mut sim_state = Self::at_rest(sim);
        if is_late {
            look_back(sim, &sim_state.state)?;
        } else {
            sim.forward()?;
            sim.set_state(&sim_state.state);
        }
        if pose::distance(robot.effector(sim).position, observed.effector.position) < Observed::NEAR {
            let Observed { effector: Effector { position, yaw }, contact } = observed;
            sim_state.state.extend(position);
            sim_state.state.extend([yaw, contact]);
            sim_state.moment = Moment::Recorded;
        }
        Ok(sim_state)
    }

    /// What a recorded row has besides the state, until the first step.
    pub(super) fn observed(&self) -> Option<Observed> {
        let &[.., x, y, z, yaw, contact] = self.state.as_slice() else { return None };
        let effector = Effector { position: [x, y, z], yaw };
        (self.moment == Moment::Recorded).then_some(Observed { effector, contact })
    }

    /// The state alone.
    fn state(&self) -> &[f64] {
        match self.moment {
            Moment::Recorded => &self.state[..self.state.len().saturating_sub(Observed::DIM)],
            Moment::AtRest | Moment::BeforeStep => &self.state,
        }
    }

    /// One control step.
    pub(super) fn advance(&mut self, sim: &mut Simulation) -> Result<(), MujocoError> {
        self.moment = Moment::BeforeStep;
        sim.advance(SUBSTEPS, &mut self.state)
    }

    /// Restores the state.
    pub(super) fn restore(&self, sim: &mut Simulation) -> Result<(), MujocoError> {
        match self.moment {
            Moment::BeforeStep => sim.replay_last(&self.state),
            Moment::AtRest | Moment::Recorded => sim.load_state_and_compute(self.state()),
        }
    }

    /// Undoes what computing has changed of the present state: where its next solution begins. `is_late`: see
    /// [`SimState::recorded`].
    pub(super) fn finish(
        &self,
        sim: &mut Simulation,
        robot: &Robot,
        is_late: bool,
    ) -> Result<(), MujocoError> {
        match self.moment {
            Moment::BeforeStep => return Ok(()),
            Moment::Recorded if is_late => look_back(sim, self.state())?,
            Moment::AtRest | Moment::Recorded => sim.set_state(self.state()),
        }
        if let Some(Observed { contact, .. }) = self.observed() {
            robot.set_gripper_contact(sim, contact);
        }
        Ok(())
    }
}

/// Computes everything where it was one physics step before a state, and sets the state.
fn look_back(sim: &mut Simulation, state: &[f64]) -> Result<(), MujocoError> {
    let time_step_s = sim.model().timestep_s();
    for joint in 0..sim.model().njnt() {
        let (at, velocity_at) = sim.model().joint_addresses(joint);
        let velocity = sim.qvel()[velocity_at..].to_vec();
        let kind = sim.model().joint_kind(joint);
        let places = match kind {
            JointKind::Hinge | JointKind::Slide => 1,
            JointKind::Free => 3,
            JointKind::Ball => 0,
        };
        let qpos = &mut sim.qpos_mut()[at..];
        qpos.iter_mut().zip(&velocity).take(places).for_each(|(place, speed)| *place -= time_step_s * speed);
        if let (JointKind::Free | JointKind::Ball, [w, x, y, z, ..], [a, b, c, ..]) =
            (kind, &mut qpos[places..], &velocity[places..])
        {
            let speed = (a * a + b * b + c * c).sqrt();
            if speed > 0.0 {
                let back = pose::about([a / speed, b / speed, c / speed], -time_step_s * speed);
                [*w, *x, *y, *z] = pose::normalize(pose::multiply([*w, *x, *y, *z], back));
            }
        }
    }
    let computed = sim.forward();
    sim.set_state(state);
    computed
}
