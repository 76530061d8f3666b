//! What an episode knows beside the state of the simulation: what is wanted, and the states of the buttons.

use serde::{Deserialize, Serialize};

/// What is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Pursued {
    /// Everything where it belongs.
    Everything,
    /// This cube where it belongs.
    Cube(u8),
    /// This button in the state that it should have.
    Button(u8),
    /// The drawer where it belongs.
    Drawer,
    /// The window where it belongs.
    Window,
}

impl Pursued {
    /// The number in the column `privileged.target_task`.
    pub(super) fn code(self) -> i64 {
        match self {
            Pursued::Everything | Pursued::Cube(_) => 0,
            Pursued::Button(_) => 1,
            Pursued::Drawer => 2,
            Pursued::Window => 3,
        }
    }
}

/// The episode as it stands, beside the simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TaskState {
    /// The episode's seed: targets are drawn on the way.
    pub(super) seed: i64,
    /// Targets that there have been.
    pub(super) targets: u64,
    /// A cube was a target: its goal was that of the factors.
    pub(super) has_had_cube: bool,
    /// What is wanted.
    pub(super) pursued: Pursued,
    /// The goal was given: it stays.
    pub(super) goal_is_given: bool,
    /// 1 to 5; 0 without a task.
    pub(super) task: i64,
    /// Whether what is wanted is reached.
    pub(super) success: bool,
    /// States of the buttons; 1 unlocks.
    pub(super) buttons: [u8; 2],
    /// The states that they should have.
    pub(super) goal_buttons: [u8; 2],
    /// Where drawer and window should be, m.
    pub(super) goal_slides: [f64; 2],
    /// The positions before the last control step.
    pub(super) before_qpos: Vec<f64>,
    /// The velocities before the last control step.
    pub(super) before_qvel: Vec<f64>,
    /// The buttons before the last control step.
    pub(super) before_buttons: [u8; 2],
}

impl TaskState {
    /// Before anything is known.
    pub(super) fn new(seed: i64, nq: usize, nv: usize) -> Self {
        Self {
            seed,
            targets: 0,
            has_had_cube: false,
            pursued: Pursued::Everything,
            goal_is_given: false,
            task: 0,
            success: false,
            buttons: [0; 2],
            goal_buttons: [0; 2],
            goal_slides: [0.0; 2],
            before_qpos: vec![0.0; nq],
            before_qvel: vec![0.0; nv],
            before_buttons: [0; 2],
        }
    }
}
