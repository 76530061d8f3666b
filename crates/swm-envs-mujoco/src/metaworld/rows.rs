//! The columns of a row, and starts and goals from recorded ones.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvError, Field, RowsMut, Value};

use super::env::MetaWorldEnv;
use super::reward::{PARTS, Worth};
use super::robot::{Frame, Origin};
use crate::inputs::{check_goal, needed, recall, recorded};
use swm_mujoco::MujocoError;

/// The episode as it stands, beside the simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TaskState {
    /// Control steps taken.
    pub(super) steps: u64,
    pub(super) origin: Origin,
    /// What is observed now, and what was before.
    pub(super) frames: [Frame; 2],
    pub(super) worth: Worth,
    /// Positions that the image of the goal shows; see `is_goal_recorded`.
    pub(super) goal_qpos: Vec<f64>,
    /// Whether they are those of a recorded row; else of the start, and what is moved is brought to the goal.
    pub(super) is_goal_recorded: bool,
}

/// Values of an observation: two frames and the goal.
const OBSERVED: usize = 39;
/// The step columns before the parts of the reward, in the order of `fields`.
const STEP: usize = 12;
/// Where the columns of the episode begin: `desired_goal`, `goal_state`, the factors, then images.
pub(super) const EPISODE: usize = STEP + PARTS.len();

/// The columns that a start may name.
pub(super) const START: &[&str] =
    &["qpos", "qvel", "time", "qacc_warmstart", "mocap_pos", "ctrl", "desired_goal"];
/// What a start takes besides: what was observed, and what it was worth.
pub(super) const START_EXTRAS: &[&str] = &["observation", PARTS[0], PARTS[1], PARTS[2], PARTS[3], PARTS[4]];

/// The columns before the factors, for `nq` positions and `nv` velocities.
pub(super) fn fields([nq, nv]: [usize; 2]) -> Vec<Field> {
    let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
    let mut fields = vec![
        step("observation", OBSERVED),
        Field::step("state", Dtype::F32, &[OBSERVED]),
        Field::step("proprio", Dtype::F32, &[4]),
        step("achieved_goal", 3),
        step("tips", 3),
        step("qpos", nq),
        step("qvel", nv),
        Field::step("time", Dtype::F64, &[]),
        step("qacc_warmstart", nv),
        step("mocap_pos", 3),
        step("mocap_quat", 4),
        step("ctrl", 2),
    ];
    fields.extend(PARTS.map(|name| Field::step(name, Dtype::F64, &[])));
    fields.push(Field::episode("desired_goal", Dtype::F64, &[3]));
    fields.push(Field::episode("goal_state", Dtype::F32, &[3]));
    fields
}

impl MetaWorldEnv {
    /// Writes the step columns, without images.
    pub(super) fn write_step(&self, out: &mut RowsMut<'_>) {
        let TaskState { origin, frames: [now, before], worth, .. } = &self.task_state;
        let goal = if self.settings.goal_observable { origin.target } else { [0.0; 3] };
        let observed = || now.iter().chain(before).chain(&goal);
        let as_single = |target: &mut [f32]| {
            for (target, value) in target.iter_mut().zip(observed()) {
                *target = *value as f32;
            }
        };
        for (target, value) in out.at::<f64>(0).iter_mut().zip(observed()) {
            *target = *value;
        }
        as_single(out.at(1));
        as_single(out.at(2));
        let sim = &self.robot.sim;
        out.write(3, &self.robot.achieved());
        out.write(4, &self.robot.tips());
        out.write(5, sim.qpos());
        out.write(6, sim.qvel());
        out.write(7, &[sim.time_s()]);
        out.write(8, sim.qacc_warmstart());
        out.write(9, sim.mocap_pos());
        out.write(10, sim.mocap_quat());
        out.write(11, sim.ctrl());
        for (k, part) in worth.parts.iter().enumerate() {
            out.write(STEP + k, &[*part]);
        }
    }

    /// Stands at a recorded row. Where it has all columns, what follows has the recorded bits.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = self.task.id;
        let (nq, nv) = (self.robot.sim.model().nq(), self.robot.sim.model().nv());
        let (qpos, qvel) = (needed(id, row, "start", "qpos", nq)?, needed(id, row, "start", "qvel", nv)?);
        let warmstart = recorded(id, row, "qacc_warmstart", nv)?.unwrap_or_else(|| vec![0.0; nv]);
        let at_reset = |error: MujocoError| error.at_reset(id);
        let sim = &mut self.robot.sim;
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        if let Some(ctrl) = recorded(id, row, "ctrl", sim.model().nu())? {
            sim.ctrl_mut().copy_from_slice(&ctrl);
        }
        sim.forward().map_err(at_reset)?;
        // Where it is not recorded, the hand is pulled to where it is.
        let hand = self.robot.look()[..3].to_vec();
        let sim = &mut self.robot.sim;
        sim.mocap_pos_mut().copy_from_slice(&recorded(id, row, "mocap_pos", 3)?.unwrap_or(hand));
        sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        sim.forward().map_err(at_reset)?;
        sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        if let Some(goal) = recorded(id, row, "desired_goal", 3)? {
            self.task_state.origin.target = [goal[0], goal[1], goal[2]];
        }
        Ok(())
    }

    /// Takes what was observed from a recorded row, and what it was worth, if the row has it: the frame before does not follow
    /// from the state. Another state's is not taken.
    pub(super) fn recall_observation(&mut self, row: &BTreeMap<String, Value>) {
        /// How far the hand moves in a physics step, at most, m.
        const NEAR: f64 = 0.01;
        let mut observed = [f64::NAN; OBSERVED];
        recall(row, "observation", &mut observed);
        let TaskState { frames, worth, .. } = &mut self.task_state;
        let is_of_state = observed.iter().all(|value| value.is_finite())
            && observed[..3].iter().zip(&frames[0]).all(|(a, b)| (a - b).abs() < NEAR);
        if !is_of_state {
            return;
        }
        let (first, rest) = observed.split_at(18);
        frames[0].copy_from_slice(first);
        frames[1].copy_from_slice(&rest[..18]);
        for (part, name) in worth.parts.iter_mut().zip(PARTS) {
            let mut value = [*part];
            recall(row, name, &mut value);
            *part = if value[0].is_finite() { value[0] } else { *part };
        }
    }

    /// Wants what is moved where it is in a recorded row.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = self.task.id;
        check_goal(&self.spec, row)?;
        let goal = needed(id, row, "goal", "achieved_goal", 3)?;
        self.task_state.origin.target = [goal[0], goal[1], goal[2]];
        if let Some(qpos) = recorded(id, row, "qpos", self.robot.sim.model().nq())? {
            (self.task_state.goal_qpos, self.task_state.is_goal_recorded) = (qpos, true);
        }
        Ok(())
    }
}
