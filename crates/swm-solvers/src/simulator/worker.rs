//! One environment that rolls plans out, and computes finite differences of their costs.

use std::ops::Range;

use swm_core::env::step_times;
use swm_core::{Column, Dtype, Env, EnvError, EnvState, Space};

use super::options::{Aggregate, SimulatorOptions};
use crate::context::ActionMap;
use crate::error::PlanError;
use crate::space::{categories, largest};

/// What all rollouts share.
pub(super) struct Simulation<'a> {
    /// Id of the environment.
    pub(super) env: &'a str,
    pub(super) options: &'a SimulatorOptions,
    pub(super) map: &'a ActionMap,
}

/// An environment to simulate in.
pub(super) struct Worker {
    env: Box<dyn Env>,
    /// The action that it is given.
    action: Column,
    /// `[A]`: an action of a plan, perturbed.
    moved: Vec<f32>,
    /// The state in which perturbed actions begin.
    fork: EnvState,
}

/// Accumulated costs of a rollout.
#[derive(Clone, Copy)]
struct Tally {
    sum: f64,
    best: f64,
    taken: usize,
    /// Whether success gives a bonus.
    bonus: bool,
}

impl Tally {
    fn new(bonus: bool) -> Self {
        Self { sum: 0.0, best: f64::INFINITY, taken: 0, bonus }
    }
}

impl Worker {
    pub(super) fn new(env: Box<dyn Env>) -> Self {
        let space = &env.spec().action;
        let action = Column::zeros(space.dtype().unwrap_or(Dtype::F32), space.dim());
        Self { env, action, moved: Vec::new(), fork: EnvState::new() }
    }

    pub(super) fn action_space(&self) -> &Space {
        &self.env.spec().action
    }

    /// The cost of executing `plan`, `[T, A]`, from `start`.
    pub(super) fn roll_out(
        &mut self,
        simulation: &Simulation<'_>,
        start: &EnvState,
        plan: &[f32],
    ) -> Result<f64, PlanError> {
        self.env.restore(start)?;
        self.finish(simulation, Tally::new(simulation.options.gives_bonus()), plan, 0)
    }

    /// Calls `write(index, difference)` for all values of the actions `steps` of `plan`, `[T, A]`.
    pub(super) fn differences(
        &mut self,
        simulation: &Simulation<'_>,
        start: &EnvState,
        plan: &[f32],
        steps: Range<usize>,
        mut write: impl FnMut(usize, f64),
    ) -> Result<(), PlanError> {
        let dim = simulation.map.dim();
        let count = plan.len() / dim;
        let mut tally = Tally::new(false);
        let mut end = None;
        self.env.restore(start)?;
        for step in 0..steps.end {
            if end.is_some() {
                // The rollout is over: later actions change nothing.
                (step.max(steps.start)..steps.end).for_each(|step| {
                    (step * dim..(step + 1) * dim).for_each(|index| write(index, 0.0));
                });
                return Ok(());
            }
            if step >= steps.start {
                self.env.snapshot(&mut self.fork)?;
                self.differences_of(simulation, tally, plan, step, &mut write)?;
                self.env.restore(&self.fork)?;
            }
            end = self.act(simulation, &mut tally, &plan[step * dim..][..dim], step + 1 == count)?;
        }
        Ok(())
    }

    /// The finite differences of action `step`, which is taken from the fork.
    fn differences_of(
        &mut self,
        simulation: &Simulation<'_>,
        tally: Tally,
        plan: &[f32],
        step: usize,
        write: &mut impl FnMut(usize, f64),
    ) -> Result<(), PlanError> {
        let dim = simulation.map.dim();
        let first = step * dim;
        let action = &plan[first..][..dim];
        let mut moved = std::mem::take(&mut self.moved);
        moved.clear();
        moved.extend_from_slice(action);
        let mut offset = 0;
        for count in categories(simulation.map.space()) {
            let group = offset..offset + count;
            let present = largest(&action[group.clone()]);
            let mut costs = |category: usize| {
                moved[group.clone()].fill(0.0);
                moved[offset + category] = 1.0;
                self.fork_with(simulation, tally, &moved, plan, step)
            };
            let base = costs(present)?;
            for category in 0..count {
                let cost = if category == present { base } else { costs(category)? };
                write(first + offset + category, cost - base);
            }
            moved[group.clone()].copy_from_slice(&action[group]);
            offset += count;
        }
        let distance = simulation.options.gradient_step as f32;
        for index in offset..dim {
            let (low, high) = (action[index] - distance, action[index] + distance);
            moved[index] = low;
            let behind = self.fork_with(simulation, tally, &moved, plan, step)?;
            moved[index] = high;
            let ahead = self.fork_with(simulation, tally, &moved, plan, step)?;
            moved[index] = action[index];
            write(first + index, (ahead - behind) / f64::from(high - low));
        }
        self.moved = moved;
        Ok(())
    }

    /// The cost if action `step` were `action`.
    fn fork_with(
        &mut self,
        simulation: &Simulation<'_>,
        mut tally: Tally,
        action: &[f32],
        plan: &[f32],
        step: usize,
    ) -> Result<f64, PlanError> {
        self.env.restore(&self.fork)?;
        let last = (step + 1) * simulation.map.dim() == plan.len();
        match self.act(simulation, &mut tally, action, last)? {
            Some(cost) => Ok(cost),
            None => self.finish(simulation, tally, plan, step + 1),
        }
    }

    /// The cost of executing the rest of `plan`, from action `first` on.
    fn finish(
        &mut self,
        simulation: &Simulation<'_>,
        mut tally: Tally,
        plan: &[f32],
        first: usize,
    ) -> Result<f64, PlanError> {
        let dim = simulation.map.dim();
        let count = plan.len() / dim;
        for (step, action) in plan.chunks_exact(dim).enumerate().skip(first) {
            if let Some(cost) = self.act(simulation, &mut tally, action, step + 1 == count)? {
                return Ok(cost);
            }
        }
        Ok(f64::INFINITY)
    }

    /// Takes one action. If the rollout ends with it, returns its cost: infinity if it diverged.
    fn act(
        &mut self,
        simulation: &Simulation<'_>,
        tally: &mut Tally,
        action: &[f32],
        last: bool,
    ) -> Result<Option<f64>, PlanError> {
        let Simulation { env, options, map } = simulation;
        map.write(action, &mut self.action.as_slice_mut());
        if !self.action.as_slice().is_finite() {
            return Ok(Some(f64::INFINITY));
        }
        let outcome = match step_times(self.env.as_mut(), self.action.as_slice(), options.frame_skip) {
            Ok(outcome) => outcome,
            Err(EnvError::Diverged { .. }) => return Ok(Some(f64::INFINITY)),
            Err(error) => return Err(error.into()),
        };
        tally.taken += 1;
        if tally.bonus && outcome.success == Some(true) {
            return Ok(Some(tally.taken as f64 - options.success_bonus));
        }
        let terminated = outcome.terminated && (options.stop_at_success || outcome.success != Some(true));
        let ends = terminated || last;
        if !ends && options.aggregate == Aggregate::Last {
            return Ok(None);
        }
        let cost = self.env.task_cost().ok_or_else(|| PlanError::NoTaskCost { env: (*env).to_owned() })?;
        tally.sum += cost;
        tally.best = cost.min(tally.best);
        Ok(ends.then_some(match options.aggregate {
            Aggregate::Last => cost,
            Aggregate::Mean => tally.sum / tally.taken as f64,
            Aggregate::Best => tally.best,
        }))
    }
}
