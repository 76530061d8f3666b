//! What Python sees of a World and the core does not keep: the last actions, and what the last step gave.
//!
//! In the core's infos, `action` is the one that is about to be taken, and a finished environment looks as it ended. In
//! Python's, `action` is the last one that was taken, as in the reference, and environments that run no more episode are
//! `terminated`, so that policies leave them alone.

use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use swm::core::{Batch, Column, Dtype, Slice, View, World};

use crate::errors::OrRaise as _;

/// These columns, `[N, …]`, at the same addresses for as long as the World lives.
pub(crate) struct Mirror {
    /// The last actions, `[N, …action shape]`.
    action: Column,
    action_shape: Vec<usize>,
    /// Of the infos: 0 or 1.
    terminated: Vec<u8>,
    truncated: Vec<u8>,
    /// Of the last step: no reward and no end where it did nothing.
    rewards: Vec<f32>,
    terminateds: Vec<u8>,
    truncateds: Vec<u8>,
    /// Positions of reward, terminated, truncated in the infos.
    columns: [usize; 3],
    /// Which environments the present step steps.
    stepped: Vec<bool>,
    /// The episode that each environment was in, in a run.
    episodes: Vec<Option<u64>>,
}

/// One environment's row of a [`Mirror`].
#[derive(Serialize, Deserialize)]
pub(crate) struct SavedRow {
    action: Column,
    /// `terminated` and `truncated` of the infos, then those of the last step.
    flags: [bool; 4],
    reward: f32,
}

/// One column of a [`Mirror`].
pub(crate) struct Mirrored<'a> {
    /// Its name.
    pub(crate) name: &'static str,
    /// `[N, …shape]` values.
    pub(crate) values: Slice<'a>,
    /// Shape of one environment's values.
    pub(crate) shape: &'a [usize],
    /// Whether it belongs into the infos, rather than to the results of a step.
    pub(crate) is_info: bool,
    /// Whether its bytes are booleans.
    pub(crate) is_flag: bool,
}

impl Mirror {
    /// For a World that has not been reset.
    pub(crate) fn new(world: &World) -> PyResult<Self> {
        let (space, num_envs) = (&world.spec().action, world.options().num_envs);
        let mut action = Column::zeros(space.dtype().unwrap_or(Dtype::F32), num_envs * space.dim());
        action.as_slice_mut().fill_missing();
        let schema = world.infos().schema();
        let find = |name: &str| schema.require(name).or_raise();
        Ok(Self {
            action,
            action_shape: space.shape(),
            terminated: vec![0; num_envs],
            truncated: vec![0; num_envs],
            rewards: vec![0.0; num_envs],
            terminateds: vec![0; num_envs],
            truncateds: vec![0; num_envs],
            columns: [find("reward")?, find("terminated")?, find("truncated")?],
            stepped: vec![false; num_envs],
            episodes: vec![None; num_envs],
        })
    }

    /// The columns.
    pub(crate) fn columns(&self) -> [Mirrored<'_>; 6] {
        let flag = |name, values, is_info| Mirrored {
            name,
            values: Slice::U8(values),
            shape: &[],
            is_info,
            is_flag: true,
        };
        let (action, shape) = (self.action.as_slice(), &self.action_shape[..]);
        [
            Mirrored { name: "action", values: action, shape, is_info: true, is_flag: false },
            flag("terminated", &self.terminated, true),
            flag("truncated", &self.truncated, true),
            Mirrored {
                name: "rewards",
                values: Slice::F32(&self.rewards),
                shape: &[],
                is_info: false,
                is_flag: false,
            },
            flag("terminateds", &self.terminateds, false),
            flag("truncateds", &self.truncateds, false),
        ]
    }

    /// Notes which environments are about to step: those of `mask` that are in an episode.
    pub(crate) fn begin_step(&mut self, world: &World, mask: Option<&[bool]>) {
        self.stepped.fill(false);
        for row in world.view().live() {
            self.stepped[row] = mask.is_none_or(|mask| mask[row]);
        }
    }

    /// After the step with `actions`: what was done, and what came of it.
    pub(crate) fn end_step(&mut self, infos: &Batch, actions: Slice<'_>) {
        let [reward, terminated, truncated] = self.columns.map(|index| infos.column(index));
        let (Slice::F64(reward), Slice::Bool(terminated), Slice::Bool(truncated)) =
            (reward, terminated, truncated)
        else {
            unreachable!("these columns have one type in every World")
        };
        let dim = actions.len() / self.stepped.len();
        for (row, &is_stepped) in self.stepped.iter().enumerate() {
            let (has_terminated, is_truncated) = (u8::from(terminated[row]), u8::from(truncated[row]));
            let counts = u8::from(is_stepped);
            self.terminated[row] = has_terminated;
            self.truncated[row] = is_truncated;
            self.terminateds[row] = has_terminated & counts;
            self.truncateds[row] = is_truncated & counts;
            self.rewards[row] = if is_stepped { reward[row] as f32 } else { 0.0 };
            if is_stepped {
                let (_, rest) = self.action.as_slice_mut().split_at(row * dim);
                let is_copied = rest.split_at(dim).0.copy_from(actions.range(row * dim, dim));
                debug_assert!(is_copied, "actions have the space's type");
            }
        }
    }

    /// An environment was reset.
    pub(crate) fn reset(&mut self, row: usize) {
        let dim = self.action.len() / self.stepped.len();
        let (_, rest) = self.action.as_slice_mut().split_at(row * dim);
        rest.split_at(dim).0.fill_missing();
        for flags in [&mut self.terminated, &mut self.truncated, &mut self.terminateds, &mut self.truncateds]
        {
            flags[row] = 0;
        }
        self.rewards[row] = 0.0;
    }

    /// An environment's row.
    pub(crate) fn save(&self, row: usize) -> SavedRow {
        let dim = self.action.len() / self.stepped.len();
        let flags = [&self.terminated, &self.truncated, &self.terminateds, &self.truncateds];
        SavedRow {
            action: self.action.as_slice().range(row * dim, dim).to_column(),
            flags: flags.map(|flags| flags[row] != 0),
            reward: self.rewards[row],
        }
    }

    /// Goes back to a saved row; whether its action is of the same type and length, else it stays missing.
    pub(crate) fn restore(&mut self, row: usize, saved: &SavedRow) -> bool {
        self.reset(row);
        let dim = self.action.len() / self.stepped.len();
        let (_, rest) = self.action.as_slice_mut().split_at(row * dim);
        let is_copied = rest.split_at(dim).0.copy_from(saved.action.as_slice());
        let flags = [&mut self.terminated, &mut self.truncated, &mut self.terminateds, &mut self.truncateds];
        for (flags, saved) in flags.into_iter().zip(saved.flags) {
            flags[row] = u8::from(saved);
        }
        self.rewards[row] = saved.reward;
        is_copied
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
        let mut idle = vec![true; num_envs];
        self.stepped.fill(false);
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
        for (row, &is_idle) in idle.iter().enumerate() {
            if is_idle {
                self.terminated[row] = 1;
            } else if !self.stepped[row] {
                self.reset(row);
            }
        }
        begun
    }

    /// A run is over, and nothing is known of single steps.
    pub(crate) fn end_run(&mut self) {
        for row in 0..self.stepped.len() {
            self.reset(row);
            self.terminated[row] = 1;
        }
    }
}
