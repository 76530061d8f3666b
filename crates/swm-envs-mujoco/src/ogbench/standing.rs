//! Where the simulation stands, as what is needed to stand there again with every bit, images included.
//!
//! After a control step OGBench reads and renders what was computed before the last physics step. So the task_state is the state
//! before that step, which is then repeated.

use serde::{Deserialize, Serialize};

use super::env::SUBSTEPS;
use crate::error::MujocoError;
use crate::ffi::Simulation;

/// A state to stand at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Standing {
    state: Vec<f64>,
    /// The task_state is one physics step after the state.
    has_stepped: bool,
}

/// What an episode should end like.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Goal {
    pub(super) standing: Standing,
    /// The states of the buttons.
    pub(super) buttons: [u8; 2],
    pub(super) observation: Vec<f64>,
}

impl Standing {
    /// The present state, from which everything has been computed.
    pub(super) fn at_rest(sim: &Simulation) -> Self {
        let mut state = Vec::new();
        sim.save_state(&mut state);
        Self { state, has_stepped: false }
    }

    /// One control step.
    pub(super) fn advance(&mut self, sim: &mut Simulation) -> Result<(), MujocoError> {
        self.has_stepped = true;
        sim.advance(SUBSTEPS, &mut self.state)
    }

    /// Stands there again.
    pub(super) fn restore(&self, sim: &mut Simulation) -> Result<(), MujocoError> {
        if self.has_stepped { sim.replay_last(&self.state) } else { sim.load_state_and_compute(&self.state) }
    }

    /// Undoes what computing has changed of a state at rest: where its next solution begins.
    pub(super) fn finish(&self, sim: &mut Simulation) {
        if !self.has_stepped {
            sim.set_state(&self.state);
        }
    }
}
