//! Starts and goals from recorded rows.

use std::collections::BTreeMap;

use swm_core::{EnvError, EnvSpec, Value};

use super::TableEnv;
use crate::inputs::{check_goal, needed, recall, recorded};
use crate::ogbench::furniture::Which;
use crate::ogbench::robot::Effector;
use crate::ogbench::settings::Mode;
use crate::ogbench::sim_state::Observed;
use crate::ogbench::start::Chosen;
use crate::ogbench::state::Pursued;

/// The columns that a start may name.
pub(super) const START: &[&str] = &[
    "qpos",
    "qvel",
    "time",
    "qacc_warmstart",
    "control",
    "mocap_pos",
    "mocap_quat",
    "privileged.target_block",
    "task_id",
];
pub(super) const SCENE_START: &[&str] = &[
    "qpos",
    "qvel",
    "time",
    "qacc_warmstart",
    "control",
    "mocap_pos",
    "mocap_quat",
    "button_states",
    "privileged.target_task",
    "privileged.target_button",
    "privileged.target_button_state",
    "privileged.target_drawer_pos",
    "privileged.target_window_pos",
    "task_id",
];

/// What rows have besides: see [`Observed`].
pub(super) const START_EXTRAS: &[&str] = &[
    "prev_qpos",
    "prev_qvel",
    "proprio.effector_pos",
    "proprio.effector_yaw",
    "proprio.gripper_contact",
    "privileged.target_number",
];
pub(super) const SCENE_START_EXTRAS: &[&str] = &[
    "prev_qpos",
    "prev_qvel",
    "prev_button_states",
    "proprio.effector_pos",
    "proprio.effector_yaw",
    "proprio.gripper_contact",
    "privileged.target_number",
];

impl TableEnv {
    /// Stands at a recorded row.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = &self.spec.id;
        let Self { sim, table, task_state, .. } = self;
        let (nq, nv, nu) = (sim.model().nq(), sim.model().nv(), sim.model().nu());
        let cubes = table.kind.cubes();
        let qpos = needed(id, row, "start", "qpos", nq)?;
        let qvel = needed(id, row, "start", "qvel", nv)?;
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        sim.qacc_warmstart_mut().fill(0.0);
        if let Some(control) = recorded(id, row, "control", nu)? {
            sim.ctrl_mut().copy_from_slice(&control);
        }
        if let Some(warmstart) = recorded(id, row, "qacc_warmstart", nv)? {
            sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        }
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        if let Some(states) = recorded(id, row, "button_states", 2)? {
            task_state.buttons = states_of(&states);
        }
        match self.settings.mode {
            Mode::DataCollection => self.want_target(row)?,
            Mode::Task => self.want_task(row)?,
        }
        let Self { spec: EnvSpec { id, .. }, sim, .. } = self;
        if let Some(goals) = recorded(id, row, "mocap_pos", 3 * cubes)? {
            sim.mocap_pos_mut().copy_from_slice(&goals);
        }
        if let Some(turns) = recorded(id, row, "mocap_quat", 4 * cubes)? {
            sim.mocap_quat_mut().copy_from_slice(&turns);
        }
        Ok(())
    }

    /// Takes from a recorded row what was before its last step. Returns what was computed then.
    pub(super) fn recall(&mut self, row: &BTreeMap<String, Value>) -> Option<Observed> {
        let state = &mut self.task_state;
        recall(row, "prev_qpos", &mut state.before_qpos);
        recall(row, "prev_qvel", &mut state.before_qvel);
        let mut buttons = state.before_buttons.map(f64::from);
        recall(row, "prev_button_states", &mut buttons);
        state.before_buttons = states_of(&buttons);
        let mut targets = [state.targets as f64];
        recall(row, "privileged.target_number", &mut targets);
        state.targets = targets[0] as u64;
        let mut observed = [f64::NAN; 5];
        recall(row, "proprio.effector_pos", &mut observed[..3]);
        recall(row, "proprio.effector_yaw", &mut observed[3..4]);
        recall(row, "proprio.gripper_contact", &mut observed[4..]);
        let [x, y, z, yaw, contact] = observed;
        let effector = Effector { position: [x, y, z], yaw };
        observed.iter().all(|value| value.is_finite()).then_some(Observed { effector, contact })
    }

    /// Wants what the expert was after in a recorded row. Where the row does not tell, the cube whose goal it shows.
    fn want_target(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let Self { spec: EnvSpec { id, .. }, sim, table, task_state, .. } = self;
        let cubes = table.kind.cubes();
        let index = |name: &str, below: usize| index_in(id, row, name, below);
        let task = index("privileged.target_task", if table.furniture.is_some() { 4 } else { 1 })?;
        let goals = recorded(id, row, "mocap_pos", 3 * cubes)?;
        let shown = goals.and_then(|goals| goals.chunks_exact(3).position(|goal| goal[2] > 0.0));
        let Some(furniture) = &table.furniture else {
            if let Some(cube) = index("privileged.target_block", cubes)?.or(shown) {
                task_state.pursued = Pursued::Cube(cube as u8);
            }
            return Ok(());
        };
        task_state.goal_buttons = task_state.buttons;
        for which in [Which::Drawer, Which::Window] {
            let goal = recorded(id, row, which.target_column(), 1)?;
            let goal = goal.map_or(furniture.position(sim, which)[0], |goal| goal[0]);
            task_state.goal_slides[which as usize] = goal;
            furniture.set_handle_target(sim.model_mut(), which, goal);
        }
        task_state.pursued = match task {
            Some(1) => {
                let button = index("privileged.target_button", 2)?.unwrap_or(0);
                let opposite = 1 - usize::from(task_state.buttons[button]);
                let state = index("privileged.target_button_state", 2)?.unwrap_or(opposite);
                task_state.goal_buttons[button] = state as u8;
                Pursued::Button(button as u8)
            }
            Some(2) => Pursued::Drawer,
            Some(3) => Pursued::Window,
            _ => Pursued::Cube(0),
        };
        task_state.has_had_cube = matches!(task_state.pursued, Pursued::Cube(_));
        Ok(())
    }

    /// Wants what the task of a recorded row asks for, if the row is of a task.
    fn want_task(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let Self { spec: EnvSpec { id, .. }, settings, sim, table, task_state, fov, .. } = self;
        let Some(task) = index_in(id, row, "task_id", 6)?.filter(|task| *task > 0) else { return Ok(()) };
        if let Some(asked) = settings.task.filter(|asked| *asked != task) {
            let reason = format!(
                "the start is of task {task}, the environment has `task={asked}`; use `task={task}`, or none"
            );
            return Err(EnvError::Reset { env: id.clone(), reason });
        }
        let chosen = Chosen::new(table, Some(task), settings.permute_blocks, task_state);
        chosen.set_goals(table, sim, task_state, fov);
        Ok(())
    }

    /// Wants everything where it is in a recorded row. Returns the row's positions.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<Vec<f64>, EnvError> {
        check_goal(&self.spec, row)?;
        let qpos = needed(&self.spec.id, row, "goal", "qpos", self.sim.model().nq())?;
        let Self { spec, sim, table, task_state, .. } = self;
        task_state.pursued = Pursued::Everything;
        task_state.goal_is_given = true;
        for index in 0..table.kind.cubes() {
            let (position, turn) = (table.cube_in(&qpos, index), table.cube_rotation_in(&qpos, index));
            table.set_goal(sim, index, position, turn);
        }
        if let Some(furniture) = &table.furniture {
            for which in [Which::Drawer, Which::Window] {
                let position = furniture.position_in(&qpos, which);
                task_state.goal_slides[which as usize] = position;
                furniture.set_handle_target(sim.model_mut(), which, position);
            }
            if let Some(states) = recorded(&spec.id, row, "button_states", 2)? {
                task_state.goal_buttons = states_of(&states);
            }
        }
        Ok(qpos)
    }
}

/// States of the buttons, 0 or 1.
fn states_of(recorded: &[f64]) -> [u8; 2] {
    [0, 1].map(|index| u8::from(recorded[index] > 0.5))
}

/// A recorded whole number from 0 on and below `below`, if the row has it.
fn index_in(
    env: &str,
    row: &BTreeMap<String, Value>,
    name: &str,
    below: usize,
) -> Result<Option<usize>, EnvError> {
    let Some(value) = recorded(env, row, name, 1)? else { return Ok(None) };
    (0..below).find(|index| *index as f64 == value[0]).map(Some).ok_or_else(|| EnvError::Reset {
        env: env.to_owned(),
        reason: format!(
            "the recorded `{name}` is {}; it is a whole number from 0 to {}",
            value[0],
            below - 1
        ),
    })
}
