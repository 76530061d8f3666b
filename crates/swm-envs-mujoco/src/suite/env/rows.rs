//! Rows: which columns there are, and starts from recorded ones.

use std::collections::BTreeMap;

use swm_core::{Dtype, EnvError, Field, Value};
use swm_fov::FovSpace;

use super::SuiteEnv;
use crate::inputs::{check_goal, needed, recorded};
use crate::suite::{Domain, Stage};
use crate::views::Views;

// Field indices, in the order of `fields`; behind them the domain's values, its targets and the factors.
pub(super) const OBSERVATION: usize = 0;
pub(super) const QPOS: usize = 1;
pub(super) const QVEL: usize = 2;
pub(super) const SCORE: usize = 3;
pub(super) const TIME: usize = 4;
pub(super) const QACC_WARMSTART: usize = 5;
pub(super) const ACT: usize = 6;

/// Where the variable part of a row lies.
pub(super) struct Columns {
    pub(super) infos: usize,
    pub(super) targets: usize,
    pub(super) factors: usize,
    pub(super) pixels: usize,
}

impl SuiteEnv {
    /// Stands at a recorded row. Where it has all columns, what follows has the recorded bits. Returns the row's observation, if it
    /// has one and this is it.
    pub(super) fn start_from(&mut self, row: &BTreeMap<String, Value>) -> Result<Option<Vec<f64>>, EnvError> {
        let id = &self.spec.id;
        for (index, target) in self.domain.targets.iter().enumerate() {
            if let Some(values) = recorded(id, row, target.column, target.place.dim())? {
                self.stage.set_target(index, &values);
            }
        }
        let sim = &mut self.stage.sim;
        let (nq, nv, na) = (sim.model().nq(), sim.model().nv(), sim.model().na());
        let qpos = needed(id, row, "start", "qpos", nq)?;
        let qvel = needed(id, row, "start", "qvel", nv)?;
        let warmstart = recorded(id, row, "qacc_warmstart", nv)?.unwrap_or_else(|| vec![0.0; nv]);
        sim.reset();
        sim.qpos_mut().copy_from_slice(&qpos);
        sim.qvel_mut().copy_from_slice(&qvel);
        if let Some(act) = recorded(id, row, "act", na)? {
            sim.act_mut().copy_from_slice(&act);
        }
        sim.set_time(recorded(id, row, "time", 1)?.map_or(0.0, |time| time[0]));
        sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        sim.forward_without_actuation().map_err(|error| error.at_reset(id))?;
        sim.qacc_warmstart_mut().copy_from_slice(&warmstart);
        Ok(self.recorded_observation(row))
    }

    /// Sets the goal from the columns of a recorded row.
    pub(super) fn set_goal(&mut self, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let Self { spec, stage, task, .. } = self;
        check_goal(spec, row)?;
        if row.is_empty() && !spec.goal_columns.is_empty() {
            let reason = format!("a goal needs the columns {}", spec.goal_columns.join(", "));
            return Err(EnvError::Reset { env: spec.id.clone(), reason });
        }
        for column in row.keys() {
            let dim = spec.fields.iter().find(|field| field.name == *column).map_or(0, Field::dim);
            task.set_goal(stage, column, &needed(&spec.id, row, "goal", column, dim)?);
        }
        Ok(())
    }

    /// The recorded observation, if its task can recall it: other programs may call something else so.
    fn recorded_observation(&mut self, row: &BTreeMap<String, Value>) -> Option<Vec<f64>> {
        let Self { stage, task, scratch, spec, .. } = self;
        let observed = row.get("observation")?.to_f64s("observation").ok()?;
        if observed.len() != spec.fields[OBSERVATION].dim() {
            return None;
        }
        let computed = stage.sim.sensordata().to_vec();
        task.recall(stage, &observed);
        scratch.clear();
        task.observe(stage, scratch);
        let is_it = scratch.iter().zip(&observed).all(|(found, recorded)| *found as f32 == *recorded as f32);
        if !is_it {
            stage.sim.sensordata_mut().copy_from_slice(&computed);
        }
        is_it.then_some(observed)
    }
}

/// The columns: what all domains have, then the domain's own, factors and images. `observation` is its dim.
pub(super) fn fields(
    domain: &Domain,
    stage: &Stage,
    observation: usize,
    space: &FovSpace,
    views: Option<&Views>,
) -> (Vec<Field>, Columns) {
    let model = stage.sim.model();
    let values = |name: &str, shape: &[usize]| Field::step(name, Dtype::F64, shape);
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[observation]),
        values("qpos", &[model.nq()]),
        values("qvel", &[model.nv()]),
        values("score", &[]),
        values("time", &[]),
        values("qacc_warmstart", &[model.nv()]),
    ];
    if model.na() > 0 {
        fields.push(values("act", &[model.na()]));
    }
    let infos = fields.len();
    for (name, dim) in domain.infos {
        fields.push(if *dim == 0 { values(name, &[]) } else { values(name, &[*dim]) });
    }
    let targets = fields.len();
    fields.extend(domain.targets.iter().map(|target| values(target.column, &[target.place.dim()])));
    let factors = fields.len();
    fields.extend(space.fields());
    let pixels = fields.len();
    fields.extend(views.iter().flat_map(|views| views.fields()));
    (fields, Columns { infos, targets, factors, pixels })
}
