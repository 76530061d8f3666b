//! The columns of a row, and starts and goals from recorded ones.

use std::collections::BTreeMap;

use swm_core::{Dtype, EnvError, Field, RowsMut, Value};

use super::Body;
use super::env::MazeEnv;
use super::state::TaskState;
use super::{humanoid, soccer};
use crate::inputs::{check_goal, needed, recorded};

// Positions of the step columns, in the order of `fields`; behind them those of the episode.
const OBSERVATION: usize = 0;
const QPOS: usize = 1;
const QVEL: usize = 2;
const TIME: usize = 3;
const QACC_WARMSTART: usize = 4;
const PREV_QPOS: usize = 5;
const PREV_QVEL: usize = 6;
const XY: usize = 7;
const TASK_ID: usize = 8;
const GOAL_XY: usize = 9;
const GOAL_OBSERVATION: usize = 10;
const BALL_XY: usize = 11;

/// Where the factors begin.
pub(super) fn first_factor(body: Body) -> usize {
    BALL_XY + usize::from(body.has_ball())
}

/// The columns that a start may name.
pub(super) const START_COLUMNS: &[&str] = &["qpos", "qvel", "time", "qacc_warmstart"];

/// The columns before the factors, for `nq` positions and `nv` velocities.
pub(super) fn fields(body: Body, [nq, nv]: [usize; 2]) -> Vec<Field> {
    let observed = match body {
        Body::Point => nq,
        Body::Ant | Body::AntSoccer => nq + nv,
        Body::Humanoid => humanoid::OBSERVED,
    };
    let step = |name: &str, dim: usize| Field::step(name, Dtype::F64, &[dim]);
    let mut fields = vec![
        step("observation", observed),
        step("qpos", nq),
        step("qvel", nv),
        Field::step("time", Dtype::F64, &[]),
        step("qacc_warmstart", nv),
        step("prev_qpos", nq),
        step("prev_qvel", nv),
        step("xy", 2),
        Field::episode("task_id", Dtype::I64, &[]),
        Field::episode("goal_xy", Dtype::F64, &[2]),
        Field::episode("goal_observation", Dtype::F64, &[observed]),
    ];
    if body.has_ball() {
        fields.push(step("ball_xy", 2));
    }
    fields
}

impl MazeEnv {
    /// Writes the step columns, without images.
    pub(super) fn write_step(&self, out: &mut RowsMut<'_>) {
        let (sim, task_state) = (&self.sim, &self.task_state);
        match &self.observations {
            Some(observations) => out.write(OBSERVATION, &observations.now),
            None => write_observation(self.body, out.at(OBSERVATION), sim.qpos(), sim.qvel()),
        }
        out.write(QPOS, sim.qpos());
        out.write(QVEL, sim.qvel());
        out.write(TIME, &[sim.time_s()]);
        out.write(QACC_WARMSTART, sim.qacc_warmstart());
        out.write(PREV_QPOS, &task_state.before_qpos);
        out.write(PREV_QVEL, &task_state.before_qvel);
        out.write(XY, &self.place());
        if self.body.has_ball() {
            out.write(BALL_XY, &soccer::ball_place(sim.qpos()));
        }
    }

    /// Writes the columns of the episode, without factors and images.
    pub(super) fn write_goal(&self, out: &mut RowsMut<'_>) {
        let task_state = &self.task_state;
        out.write(TASK_ID, &[task_state.task]);
        out.write(GOAL_XY, &task_state.goal);
        let TaskState { goal_qpos, goal_qvel, .. } = task_state;
        match &self.observations {
            Some(observations) => out.write(GOAL_OBSERVATION, &observations.goal),
            None => write_observation(self.body, out.at(GOAL_OBSERVATION), goal_qpos, goal_qvel),
        }
    }

    /// Stands at a recorded row.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = &self.spec.id;
        let sim = &mut self.sim;
        let (nq, nv) = (sim.model().nq(), sim.model().nv());
        let qpos = needed(id, row, "start", "qpos", nq)?;
        let qvel = needed(id, row, "start", "qvel", nv)?;
        let warmstart = recorded(id, row, "qacc_warmstart", nv)?;
        sim.reset();
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        if let Some(warmstart) = &warmstart {
            sim.qacc_warmstart_mut().copy_from_slice(warmstart);
        }
        sim.forward().map_err(|error| error.at_reset(id))?;
        if let Some(warmstart) = &warmstart {
            self.sim.qacc_warmstart_mut().copy_from_slice(warmstart);
        }
        Ok(())
    }

    /// Wants to be where a recorded row is.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        check_goal(&self.spec, row)?;
        let qpos = needed(&self.spec.id, row, "goal", "qpos", self.sim.model().nq())?;
        let task_state = &mut self.task_state;
        // A recorded goal is that of no task.
        task_state.task = 0;
        task_state.goal = if self.body.has_ball() { soccer::ball_place(&qpos) } else { [qpos[0], qpos[1]] };
        task_state.goal_qpos = qpos;
        task_state.goal_qvel.fill(0.0);
        Ok(())
    }
}

/// The reference's observation of point and ant: positions, and for the ant velocities.
fn write_observation(body: Body, out: &mut [f64], qpos: &[f64], qvel: &[f64]) {
    let (positions, velocities) = out.split_at_mut(qpos.len());
    positions.copy_from_slice(qpos);
    if body != Body::Point {
        velocities.copy_from_slice(qvel);
    }
}
