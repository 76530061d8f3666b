//! The columns of a row, and starts and goals from recorded ones.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvError, Field, RowsMut, Value};

use super::env::FetchEnv;
use super::task::{Form, Task, Variant};
use crate::inputs::{check_goal, needed, recorded};

/// The episode as it stands, beside the simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TaskState {
    /// Control steps taken.
    pub(super) steps: u64,
    /// Where the object or the gripper is wanted, m.
    pub(super) goal: [f64; 3],
    /// Positions that the image of the goal shows; see `is_goal_recorded`.
    pub(super) goal_qpos: Vec<f64>,
    /// Whether they are those of a recorded row; else of the start, and object or gripper are brought to the goal.
    pub(super) is_goal_recorded: bool,
    /// The column `proprio`. It is older than the positions with PickAndPlace.
    pub(super) observation: Vec<f64>,
}

// Positions of the step columns, in the order of `fields`.
const OBSERVATION: usize = 0;
const PROPRIO: usize = 1;
const ACHIEVED_GOAL: usize = 2;
const STATE: usize = 3;
const QPOS: usize = 4;
const QVEL: usize = 5;
const TIME: usize = 6;
const QACC_WARMSTART: usize = 7;
const MOCAP_POS: usize = 8;
const MOCAP_QUAT: usize = 9;
const CTRL: usize = 10;

/// Where the columns of the episode begin; the first is `desired_goal`, the second `goal_state`, then come the factors.
pub(super) fn episode_columns(task: Task) -> usize {
    if task.blocks_gripper() { CTRL } else { CTRL + 1 }
}

/// The columns that a start may name.
pub(super) fn start_columns(task: Task) -> &'static [&'static str] {
    const COLUMNS: &[&str] =
        &["qpos", "qvel", "time", "qacc_warmstart", "mocap_pos", "mocap_quat", "desired_goal", "ctrl"];
    if task.blocks_gripper() { &COLUMNS[..COLUMNS.len() - 1] } else { COLUMNS }
}

/// The columns before the factors, for `nq` positions and `nv` velocities.
pub(super) fn fields(variant: &Variant, [nq, nv]: [usize; 2]) -> Vec<Field> {
    let observed = variant.task.observation_dim();
    let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
    let flat = |name: &str| Field::step(name, Dtype::F32, &[observed + 3]);
    let mut fields = vec![
        if variant.form == Form::Flat { flat("observation") } else { step("observation", observed) },
        step("proprio", observed),
        step("achieved_goal", 3),
        flat("state"),
        step("qpos", nq),
        step("qvel", nv),
        Field::step("time", Dtype::F64, &[]),
        step("qacc_warmstart", nv),
        step("mocap_pos", 3),
        step("mocap_quat", 4),
    ];
    if !variant.task.blocks_gripper() {
        fields.push(step("ctrl", 2));
    }
    fields.push(Field::episode("desired_goal", Dtype::F64, &[3]));
    fields.push(Field::episode("goal_state", Dtype::F64, &[3]));
    fields
}

impl FetchEnv {
    /// Writes the step columns, without images.
    pub(super) fn write_step(&self, out: &mut RowsMut<'_>) {
        let (sim, TaskState { goal, observation, .. }) = (&self.robot.sim, &self.task_state);
        let write_flat = |target: &mut [f32]| {
            for (target, value) in target.iter_mut().zip(observation.iter().chain(goal)) {
                *target = *value as f32;
            }
        };
        match self.variant.form {
            Form::Flat => write_flat(out.at(OBSERVATION)),
            Form::Parts => out.write(OBSERVATION, observation),
        }
        out.write(PROPRIO, observation);
        out.write(ACHIEVED_GOAL, &self.achieved());
        write_flat(out.at(STATE));
        out.write(QPOS, sim.qpos());
        out.write(QVEL, sim.qvel());
        out.write(TIME, &[sim.time_s()]);
        out.write(QACC_WARMSTART, sim.qacc_warmstart());
        out.write(MOCAP_POS, sim.mocap_pos());
        out.write(MOCAP_QUAT, sim.mocap_quat());
        if !self.variant.task.blocks_gripper() {
            out.write(CTRL, sim.ctrl());
        }
    }

    /// Where the object is, or the gripper, as the observation says.
    pub(super) fn achieved(&self) -> [f64; 3] {
        let first = if self.variant.task.has_object() { 3 } else { 0 };
        std::array::from_fn(|k| self.task_state.observation[first + k])
    }

    /// Stands at a recorded row. Where it has all columns, what follows has the recorded bits.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = self.variant.id;
        let sim = &mut self.robot.sim;
        let (nq, nv) = (sim.model().nq(), sim.model().nv());
        let qpos = needed(id, row, "start", "qpos", nq)?;
        let qvel = needed(id, row, "start", "qvel", nv)?;
        sim.reset();
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        if let Some(place) = recorded(id, row, "mocap_pos", 3)? {
            sim.mocap_pos_mut().copy_from_slice(&place);
        }
        if let Some(turn) = recorded(id, row, "mocap_quat", 4)? {
            sim.mocap_quat_mut().copy_from_slice(&turn);
        }
        let nu = sim.model().nu();
        if let Some(ctrl) = recorded(id, row, "ctrl", nu)? {
            sim.ctrl_mut().copy_from_slice(&ctrl);
        }
        let warmstart = recorded(id, row, "qacc_warmstart", nv)?;
        if let Some(warmstart) = &warmstart {
            sim.qacc_warmstart_mut().copy_from_slice(warmstart);
        }
        sim.forward().map_err(|error| error.at_reset(id))?;
        if let Some(warmstart) = &warmstart {
            sim.qacc_warmstart_mut().copy_from_slice(warmstart);
        }
        if let Some(goal) = recorded(id, row, "desired_goal", 3)? {
            self.task_state.goal = [goal[0], goal[1], goal[2]];
        }
        Ok(())
    }

    /// Observes what was recorded, if the row has it: with PickAndPlace it is one physics step older than the state. Another
    /// state's is not taken.
    pub(super) fn recall_observation(&mut self, row: &BTreeMap<String, Value>) {
        /// How far things move in a physics step, at most, m.
        const NEAR: f64 = 0.05;
        let now = &mut self.task_state.observation;
        let Some(recorded) = row.get("proprio").and_then(|value| value.to_f64s("proprio").ok()) else {
            return;
        };
        // The fingers' velocities come last, and do not lag.
        let is_of_state = recorded.len() == now.len()
            && recorded.iter().all(|value| value.is_finite())
            && recorded[..6].iter().zip(&now[..6]).all(|(a, b)| (a - b).abs() < NEAR)
            && recorded.iter().rev().zip(now.iter().rev()).take(2).all(|(a, b)| a == b);
        if is_of_state {
            *now = recorded;
        }
    }

    /// Wants the object, or the gripper, where it is in a recorded row.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = self.variant.id;
        check_goal(&self.spec, row)?;
        let goal = needed(id, row, "goal", "achieved_goal", 3)?;
        self.task_state.goal = [goal[0], goal[1], goal[2]];
        if let Some(qpos) = recorded(id, row, "qpos", self.robot.sim.model().nq())? {
            (self.task_state.goal_qpos, self.task_state.is_goal_recorded) = (qpos, true);
        }
        Ok(())
    }
}
