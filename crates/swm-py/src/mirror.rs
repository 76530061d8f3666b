//! What Python sees of a World and the core does not keep: the last actions, and what the last step gave.
//!
//! In the core's infos, `action` is the one that is about to be taken, and a finished environment looks as it ended. In
//! Python's, `action` is the last one that was taken, as in the reference, and environments that run no more episode are
//! `terminated`, so that policies leave them alone.

use pyo3::prelude::*;
use swm::core::{Batch, Dtype, Field, Schema, Slice, View, World};

use crate::errors::OrRaise as _;

const ACTION: usize = 0;
const TERMINATED: usize = 1;
const TRUNCATED: usize = 2;
const REWARDS: usize = 3;
const TERMINATEDS: usize = 4;
const TRUNCATEDS: usize = 5;

/// These columns, `[N, …]`. Booleans are bytes, as Python may write into them.
pub(crate) struct Mirror {
    table: Batch,
    /// Positions of reward, terminated, truncated in the infos.
    columns: [usize; 3],
    /// Which environments the present step steps, `[N]`.
    stepped: Vec<bool>,
    /// The episode that each environment was in, `[N]`, in a run.
    episodes: Vec<Option<u64>>,
}

impl Mirror {
    /// For a World that has not been reset.
    pub(crate) fn new(world: &World) -> PyResult<Self> {
        let spec = world.spec();
        let action = spec.action.dtype().unwrap_or(Dtype::F32);
        let fields = vec![
            Field::step("action", action, &spec.action.shape()),
            Field::step("terminated", Dtype::U8, &[]),
            Field::step("truncated", Dtype::U8, &[]),
            Field::step("rewards", Dtype::F32, &[]),
            Field::step("terminateds", Dtype::U8, &[]),
            Field::step("truncateds", Dtype::U8, &[]),
        ];
        let num_envs = world.options().num_envs;
        let mut table = Batch::new(Schema::new(fields).or_raise()?, num_envs);
        table.column_mut(ACTION).fill_missing();
        let schema = world.infos().schema();
        let find = |name: &str| schema.require(name).or_raise();
        let columns = [find("reward")?, find("terminated")?, find("truncated")?];
        Ok(Self { table, columns, stepped: vec![false; num_envs], episodes: vec![None; num_envs] })
    }

    /// The columns.
    pub(crate) fn table(&self) -> &Batch {
        &self.table
    }

    /// Whether a column belongs into the infos.
    pub(crate) fn is_info(name: &str) -> bool {
        matches!(name, "action" | "terminated" | "truncated")
    }

    /// Whether a column holds booleans.
    pub(crate) fn is_flag(name: &str) -> bool {
        matches!(name, "terminated" | "truncated" | "terminateds" | "truncateds")
    }

    /// Notes which environments are about to step: those of `mask` that are in an episode.
    pub(crate) fn begin_step(&mut self, world: &World, mask: Option<&[bool]>) {
        self.stepped.fill(false);
        for row in world.view().live() {
            self.stepped[row] = mask.is_none_or(|mask| mask[row]);
        }
    }

    /// After the step with `actions`: what was done, and what came of it in the environments that stepped; no reward and no
    /// end in the others.
    pub(crate) fn end_step(&mut self, infos: &Batch, actions: Slice<'_>) {
        let [reward, terminated, truncated] = self.columns.map(|index| infos.column(index));
        let (Slice::F64(reward), Slice::Bool(terminated), Slice::Bool(truncated)) =
            (reward, terminated, truncated)
        else {
            unreachable!("these columns have one type in every World")
        };
        let dim = actions.len() / self.stepped.len();
        let mut rows = self.table.rows_mut();
        for (row, &is_stepped) in self.stepped.iter().enumerate() {
            let out = rows.select(row);
            let flags = [u8::from(terminated[row]), u8::from(truncated[row])];
            out.write(TERMINATED, &[flags[0]]);
            out.write(TRUNCATED, &[flags[1]]);
            if is_stepped {
                let is_copied = out.slice_mut(ACTION).copy_from(actions.range(row * dim, dim));
                debug_assert!(is_copied, "actions have the space's type");
                out.write(REWARDS, &[reward[row] as f32]);
                out.write(TERMINATEDS, &[flags[0]]);
                out.write(TRUNCATEDS, &[flags[1]]);
            } else {
                out.write(REWARDS, &[0.0_f32]);
                out.write(TERMINATEDS, &[0_u8]);
                out.write(TRUNCATEDS, &[0_u8]);
            }
        }
    }

    /// An environment was reset.
    pub(crate) fn reset(&mut self, row: usize) {
        let mut rows = self.table.rows_mut();
        let row = rows.select(row);
        row.slice_mut(ACTION).fill_missing();
        for flag in [TERMINATED, TRUNCATED, TERMINATEDS, TRUNCATEDS] {
            row.write(flag, &[0_u8]);
        }
        row.write(REWARDS, &[0.0_f32]);
    }

    /// A run begins: no environment has been seen in it.
    pub(crate) fn begin_run(&mut self) {
        self.episodes.fill(None);
    }

    /// Follows a run that is about to need actions, after a step with `actions`. Gives the environments that have begun an
    /// episode after another one, `[N]`, if there are any.
    pub(crate) fn follow(&mut self, view: &View<'_>, actions: Option<Slice<'_>>) -> Option<Vec<bool>> {
        let num_envs = self.stepped.len();
        let mut begun: Option<Vec<bool>> = None;
        self.stepped.fill(false);
        let mut idle = vec![true; num_envs];
        for row in view.live() {
            idle[row] = false;
            let now = view.row(row).map(|slot| slot.episode.index);
            if self.episodes[row] == now {
                self.stepped[row] = true;
                continue;
            }
            if self.episodes[row].is_some() {
                begun.get_or_insert_with(|| vec![false; num_envs])[row] = true;
            }
            self.episodes[row] = now;
        }
        if let Some(actions) = actions {
            self.end_step(view.infos(), actions);
        }
        for row in 0..num_envs {
            if idle[row] {
                self.table.rows_mut().select(row).write(TERMINATED, &[1_u8]);
            } else if !self.stepped[row] {
                self.reset(row);
            }
        }
        begun
    }

    /// A run is over, and nothing is known of single steps.
    pub(crate) fn end_run(&mut self) {
        (0..self.stepped.len()).for_each(|row| self.reset(row));
        for row in 0..self.stepped.len() {
            self.table.rows_mut().select(row).write(TERMINATED, &[1_u8]);
        }
    }
}
