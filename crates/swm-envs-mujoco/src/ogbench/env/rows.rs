//! Starts and goals from recorded rows.

use std::collections::BTreeMap;

use swm_core::{EnvError, Value};

use super::TableEnv;
use crate::ogbench::furniture::Which;
use crate::ogbench::moment::Pursued;
use crate::suite::recorded;

impl TableEnv {
    /// Stands at a recorded row.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let id = &self.spec.id;
        let needed = |name: &str| EnvError::Reset {
            env: id.clone(),
            reason: format!("a start needs the column `{name}`"),
        };
        let Self { sim, table, moment, .. } = self;
        let (nq, nv, nu) = (sim.model().nq(), sim.model().nv(), sim.model().nu());
        let cubes = table.kind.cubes();
        let qpos = recorded(id, row, "qpos", nq)?.ok_or_else(|| needed("qpos"))?;
        let qvel = recorded(id, row, "qvel", nv)?.ok_or_else(|| needed("qvel"))?;
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
        if let Some(goals) = recorded(id, row, "mocap_pos", 3 * cubes)? {
            sim.mocap_pos_mut().copy_from_slice(&goals);
            let shown = goals.chunks_exact(3).position(|goal| goal[2] > 0.0);
            if let (Pursued::Cube(_), Some(index)) = (moment.pursued, shown) {
                moment.pursued = Pursued::Cube(index as u8);
            }
        }
        if let Some(turns) = recorded(id, row, "mocap_quat", 4 * cubes)? {
            sim.mocap_quat_mut().copy_from_slice(&turns);
        }
        if let Some(states) = recorded(id, row, "button_states", 2)? {
            moment.buttons = [0, 1].map(|index| u8::from(states[index] > 0.5));
        }
        Ok(())
    }

    /// Wants everything where it is in a recorded row. Returns the row's positions.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<Vec<f64>, EnvError> {
        let id = &self.spec.id;
        let wrong = |reason: String| EnvError::Reset { env: id.clone(), reason };
        if let Some(column) = row.keys().find(|column| !self.spec.goal_columns.contains(&column.as_str())) {
            return Err(wrong(format!("`{column}` is no goal of this environment")));
        }
        let qpos = recorded(id, row, "qpos", self.sim.model().nq())?;
        let qpos = qpos.ok_or_else(|| wrong("a goal needs the column `qpos`".to_owned()))?;
        let Self { sim, table, moment, .. } = self;
        moment.pursued = Pursued::Everything;
        moment.goal_is_given = true;
        for index in 0..table.kind.cubes() {
            let (position, turn) = (table.cube_in(&qpos, index), table.cube_rotation_in(&qpos, index));
            table.set_goal(sim, index, position, turn);
        }
        if let Some(furniture) = &table.furniture {
            for which in [Which::Drawer, Which::Window] {
                let position = furniture.position_in(&qpos, which);
                moment.goal_slides[which as usize] = position;
                furniture.set_handle_target(sim.model_mut(), which, position);
            }
            if let Some(states) = recorded(id, row, "button_states", 2)? {
                moment.goal_buttons = [0, 1].map(|index| u8::from(states[index] > 0.5));
            }
        }
        Ok(qpos)
    }
}
