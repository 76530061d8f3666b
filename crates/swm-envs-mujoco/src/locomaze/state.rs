//! What an episode knows beside the state of the simulation: where to go, and how it went so far.

use serde::{Deserialize, Serialize};

/// The episode as it stands, beside the simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TaskState {
    pub(super) seed: i64,
    /// Control steps taken.
    pub(super) step: u64,
    /// 1 and so on; 0 without a task.
    pub(super) task: i64,
    /// Where to go, x, y, m.
    pub(super) goal: [f64; 2],
    /// What being there looks like.
    pub(super) goal_qpos: Vec<f64>,
    pub(super) goal_qvel: Vec<f64>,
    /// Before the last control step.
    pub(super) before_qpos: Vec<f64>,
    pub(super) before_qvel: Vec<f64>,
    /// Whether the goal was reached in the last control step, before any teleporter.
    pub(super) success: bool,
}

impl TaskState {
    /// Before anything is known.
    pub(super) fn new(seed: i64, nq: usize, nv: usize) -> Self {
        let (positions, velocities) = (|| vec![0.0; nq], || vec![0.0; nv]);
        Self {
            seed,
            step: 0,
            task: 0,
            goal: [0.0; 2],
            goal_qpos: positions(),
            goal_qvel: velocities(),
            before_qpos: positions(),
            before_qvel: velocities(),
            success: false,
        }
    }
}
