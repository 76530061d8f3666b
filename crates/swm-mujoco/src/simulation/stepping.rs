//! Physics: computing what follows from a state, and stepping.

use super::Simulation;
use crate::bindings::{Api, mjDSBL_ACTUATION, mjData, mjModel};
use crate::error::MujocoError;
use crate::guard::{guarded, warned};

impl Simulation {
    /// Computes everything that follows from the state.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Diverged`] where MuJoCo warns, [`MujocoError::Raised`] where it stops.
    pub fn forward(&mut self) -> Result<(), MujocoError> {
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe { (api.mj_forward)(model, data) })
    }

    /// As [`Simulation::forward`], with actuators off: how `dm_control` begins episodes.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::forward`].
    pub fn forward_without_actuation(&mut self) -> Result<(), MujocoError> {
        // SAFETY: a copy of the header alone. Its pointers lead to the arrays of the model, which lives longer; it is
        // lent to one call, as `const`, and never freed.
        let mut quiet = unsafe { std::ptr::read(self.model.as_ptr()) };
        quiet.opt.disableflags |= mjDSBL_ACTUATION as i32;
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, _, data| unsafe { (api.mj_forward)(&raw const quiet, data) })
    }

    /// One control step of `substeps` physics steps, in `dm_control`'s order: what depends on positions and velocities
    /// belongs to the new state, what depends on accelerations to the last physics step.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::forward`].
    pub fn control_step(&mut self, substeps: u32) -> Result<(), MujocoError> {
        let whole = if self.model.integrates_by_rk4() { substeps } else { substeps.saturating_sub(1) };
        let split = whole < substeps;
        // SAFETY: model and data are valid and belong together. `mj_step2` continues from the last call of every way to
        // change the state here: `control_step`, `forward*` and `load` end with the stages that it needs.
        self.checked(|api, model, data| unsafe {
            if split {
                (api.mj_step2)(model, data);
            }
            for _ in 0..whole {
                (api.mj_step)(model, data);
            }
            (api.mj_step1)(model, data);
        })
    }

    /// `count` physics steps. What is computed belongs to the state before the last of them.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::forward`].
    pub fn steps(&mut self, count: u32) -> Result<(), MujocoError> {
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe {
            for _ in 0..count {
                (api.mj_step)(model, data);
            }
        })
    }

    /// `substeps` physics steps, and the forces of contacts in the last one. Everything that is read afterwards belongs to
    /// the state **before** the last of them, but for `qpos`, `qvel` and the time: how OGBench steps. That state is written
    /// to `before_last`; [`Simulation::replay_last`] restores this state bit for bit.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::forward`].
    pub fn advance(&mut self, substeps: u32, before_last: &mut Vec<f64>) -> Result<(), MujocoError> {
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe {
            for _ in 1..substeps {
                (api.mj_step)(model, data);
            }
        })?;
        before_last.clear();
        self.save_state(before_last);
        self.last_step()
    }

    /// Restores the state after the [`Simulation::advance`] that left `before_last`, under a model of the same
    /// structure.
    ///
    /// # Errors
    ///
    /// A state of another size, and those of [`Simulation::forward`].
    pub fn replay_last(&mut self, before_last: &[f64]) -> Result<(), MujocoError> {
        self.load_state(before_last)?;
        self.last_step()
    }

    fn last_step(&mut self) -> Result<(), MujocoError> {
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe {
            (api.mj_step)(model, data);
            (api.mj_rnePostConstraint)(model, data);
        })
    }

    /// Computes where everything is, from the positions alone.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::forward`].
    pub fn kinematics(&mut self) -> Result<(), MujocoError> {
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe { (api.mj_kinematics)(model, data) })
    }

    /// Calls MuJoCo; its errors and its warnings become errors.
    pub(super) fn checked(
        &mut self,
        call: impl FnOnce(&Api, *const mjModel, *mut mjData),
    ) -> Result<(), MujocoError> {
        if self.failed {
            return Err(MujocoError::Raised("the simulation failed before; reset it first".to_owned()));
        }
        let (before, time_s) = (self.header().warning, self.time_s());
        let result = guarded(|| call(self.library.api(), self.model.as_ptr(), self.raw.as_ptr()));
        self.failed = result.is_err();
        result?;
        match warned(&before, &self.header().warning) {
            None => Ok(()),
            Some(warning) => Err(MujocoError::Diverged { warning, time_s }),
        }
    }
}
