//! Planning on the true dynamics: candidates are rolled out on copies of the environment itself. The ceiling that
//! learned models are compared with.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::env::step_times;
use swm_core::registry::Setting;
use swm_core::{Column, Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvState, Space};

use crate::cost::{Candidates, Cost};
use crate::error::PlanError;
use crate::mpc::{ActionMap, Moment};
use crate::settings::Settings;
use crate::solver::at_least_one;

/// What of a roll-out counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aggregate {
    /// The task cost at the end.
    #[default]
    Last,
    /// The mean over all steps: rewards being near the goal early.
    Mean,
    /// The lowest of all steps.
    Best,
}

/// Settings of [`SimulatorCost`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulatorOptions {
    /// What of a roll-out counts.
    pub aggregate: Aggregate,
    /// A roll-out that succeeds at its step t (1 is the first) ends there and costs t minus this: where task costs are
    /// not negative, 1000 lets any success beat any failure, and an early one a late one. 0: success has no part in
    /// the cost.
    pub success_bonus: f64,
    /// Environment steps per action: the `frame_skip` of the world that is planned for.
    pub frame_skip: u32,
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        Self { aggregate: Aggregate::Last, success_bonus: 1000.0, frame_skip: 1 }
    }
}

impl Settings for SimulatorOptions {
    const SETTINGS: &'static [Setting] = &[
        Setting {
            name: "aggregate",
            doc: "what of a roll-out counts: last, mean or best task cost",
            default: "last",
        },
        Setting {
            name: "success_bonus",
            doc: "success at step t of a roll-out costs t minus this; 0: no bonus",
            default: "1000",
        },
        Setting {
            name: "frame_skip",
            doc: "environment steps per action; the world's unless given",
            default: "1",
        },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        if !(self.success_bonus.is_finite() && self.success_bonus >= 0.0) {
            let reason = format!("{} is not a number from 0 on", self.success_bonus);
            return Err(PlanError::setting("success_bonus", reason));
        }
        at_least_one("frame_skip", self.frame_skip as usize)
    }
}

/// The task cost of an environment after carrying a plan out in it, by the environment's own simulation.
///
/// It forks the environment through `snapshot` and `restore` into instances of its own, one per thread, that draw no
/// pictures. A roll-out that diverges costs infinity.
pub struct SimulatorCost {
    entry: EnvEntry,
    config: EnvConfig,
    options: SimulatorOptions,
    workers: Vec<Worker>,
    /// `[B]`: where each row starts.
    starts: Vec<EnvState>,
    map: Option<Arc<ActionMap>>,
    /// Bits of the costs, so that any thread can write any of them.
    results: Vec<AtomicU64>,
}

/// An environment to simulate in, and the action that it is given.
struct Worker {
    env: Box<dyn Env>,
    action: Column,
}

/// Candidates that a thread takes at a time: few, so that threads end together, but not one, which short roll-outs
/// would spend on taking.
const TAKE: usize = 4;

impl SimulatorCost {
    /// For environments made by `entry` with `config`; pictures in it are left out.
    pub fn new(entry: &EnvEntry, config: &EnvConfig, options: SimulatorOptions) -> Result<Self, PlanError> {
        options.validate()?;
        let config = EnvConfig { image: None, settings: config.settings.clone() };
        let (starts, results) = (Vec::new(), Vec::new());
        let mut cost =
            Self { entry: *entry, config, options, workers: Vec::new(), starts, map: None, results };
        cost.hire(1)?;
        Ok(cost)
    }

    /// What one action may be.
    pub fn action_space(&self) -> &Space {
        &self.workers[0].env.spec().action
    }

    /// Makes environments until there are `count`.
    fn hire(&mut self, count: usize) -> Result<(), PlanError> {
        while self.workers.len() < count {
            let env = (self.entry.make)(&self.config)?;
            let space = &env.spec().action;
            let action = Column::zeros(space.dtype().unwrap_or(Dtype::F32), space.width());
            self.workers.push(Worker { env, action });
        }
        Ok(())
    }
}

impl Cost for SimulatorCost {
    fn prepare(&mut self, moment: &Moment<'_>) -> Result<(), PlanError> {
        if moment.view().spec().id != self.entry.id {
            let (planner, world) = (self.entry.id.to_owned(), moment.view().spec().id.clone());
            return Err(PlanError::OtherEnv { planner, world });
        }
        self.hire(rayon::current_num_threads())?;
        if self.starts.len() < moment.len() {
            self.starts.resize_with(moment.len(), EnvState::new);
        }
        for (index, start) in self.starts.iter_mut().take(moment.len()).enumerate() {
            moment.row(index).snapshot(start)?;
        }
        self.map = Some(Arc::clone(moment.actions()));
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        let Self { entry, options, workers, starts, map, results, .. } = self;
        let not_prepared =
            PlanError::Size { name: "prepared rows", expected: candidates.rows, found: starts.len() };
        let Some(map) = map.as_ref().filter(|_| starts.len() >= candidates.rows) else {
            return Err(not_prepared);
        };
        let count = costs.len();
        if results.len() < count {
            results.resize_with(count, AtomicU64::default);
        }
        let next = AtomicUsize::new(0);
        // Of several failures the first candidate's is reported, whichever thread was faster.
        let failure: Mutex<Option<(usize, PlanError)>> = Mutex::new(None);
        let busy = workers.len().min(count.div_ceil(TAKE));
        workers[..busy].par_iter_mut().with_max_len(1).for_each(|worker| {
            loop {
                let first = next.fetch_add(TAKE, Ordering::Relaxed);
                if first >= count {
                    break;
                }
                for index in first..count.min(first + TAKE) {
                    let start = &starts[index / candidates.samples];
                    match worker.roll_out(entry.id, options, map, start, candidates.plan(index)) {
                        Ok(cost) => results[index].store(cost.to_bits(), Ordering::Relaxed),
                        Err(error) => keep_first(&failure, index, error),
                    }
                }
            }
        });
        if let Some((_, error)) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        for (cost, bits) in costs.iter_mut().zip(results) {
            *cost = f64::from_bits(*bits.get_mut());
        }
        Ok(())
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.options.changed()
    }
}

fn keep_first(failure: &Mutex<Option<(usize, PlanError)>>, index: usize, error: PlanError) {
    let mut kept = failure.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.as_ref().is_none_or(|(first, _)| index < *first) {
        *kept = Some((index, error));
    }
}

impl Worker {
    /// The cost of carrying `plan`, `[H × k, A]`, out from `start`.
    fn roll_out(
        &mut self,
        env: &str,
        options: &SimulatorOptions,
        map: &ActionMap,
        start: &EnvState,
        plan: &[f32],
    ) -> Result<f64, PlanError> {
        self.env.restore(start)?;
        let steps = plan.len() / map.width();
        let (mut sum, mut best, mut taken) = (0.0, f64::INFINITY, 0);
        for action in plan.chunks_exact(map.width()) {
            map.write(action, &mut self.action.as_slice_mut());
            if !self.action.as_slice().is_finite() {
                return Ok(f64::INFINITY);
            }
            let outcome = match step_times(self.env.as_mut(), self.action.as_slice(), options.frame_skip) {
                Ok(outcome) => outcome,
                Err(EnvError::Diverged { .. }) => return Ok(f64::INFINITY),
                Err(error) => return Err(error.into()),
            };
            taken += 1;
            if options.success_bonus > 0.0 && outcome.success == Some(true) {
                return Ok(taken as f64 - options.success_bonus);
            }
            let ends = outcome.terminated || taken == steps;
            if ends || options.aggregate != Aggregate::Last {
                let cost =
                    self.env.task_cost().ok_or_else(|| PlanError::NoTaskCost { env: env.to_owned() })?;
                sum += cost;
                best = cost.min(best);
                if ends {
                    return Ok(match options.aggregate {
                        Aggregate::Last => cost,
                        Aggregate::Mean => sum / taken as f64,
                        Aggregate::Best => best,
                    });
                }
            }
        }
        Ok(f64::INFINITY)
    }
}
