//! What the humanoid observes: its place, and what the Control Suite's observes.

use crate::humanoid::Anatomy;
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Simulation};

/// Values of an observation: x, y, and the Control Suite's.
pub(super) const OBSERVED: usize = 2 + Anatomy::OBSERVED;

/// Observations of the humanoid, `[69]` each, as of when they were last [taken](Observations::observe).
pub(super) struct Observations {
    anatomy: Anatomy,
    pub(super) now: Vec<f64>,
    pub(super) goal: Vec<f64>,
}

impl Observations {
    pub(super) fn new(model: &Model) -> Result<Self, MujocoError> {
        Ok(Self { anatomy: Anatomy::new(model)?, now: vec![0.0; OBSERVED], goal: vec![0.0; OBSERVED] })
    }

    /// Observes the present state.
    pub(super) fn observe(&mut self, sim: &Simulation) {
        observe(&self.anatomy, sim, &mut self.now);
    }

    /// Observes the goal: positions `[28]`, velocities `[27]`. The state stays.
    pub(super) fn observe_goal(
        &mut self,
        sim: &mut Simulation,
        qpos: &[f64],
        qvel: &[f64],
    ) -> Result<(), MujocoError> {
        let mut kept = Vec::new();
        sim.save(&mut kept);
        sim.qpos_mut().copy_from_slice(qpos);
        sim.qvel_mut().copy_from_slice(qvel);
        sim.forward()?;
        observe(&self.anatomy, sim, &mut self.goal);
        sim.load(&kept)
    }
}

fn observe(anatomy: &Anatomy, sim: &Simulation, out: &mut Vec<f64>) {
    out.clear();
    out.extend_from_slice(&sim.qpos()[..2]);
    anatomy.observe(sim, out);
}
