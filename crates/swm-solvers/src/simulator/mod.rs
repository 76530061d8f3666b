//! Planning on the true dynamics: candidates are rolled out on copies of the environment itself. The oracle that
//! learned models are compared with.

mod options;
mod share;
mod worker;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::{Map, Value as Json};
use swm_core::{Cancel, EnvConfig, EnvEntry, EnvState, Settings as _, Space};

use self::share::share;
use self::worker::{Simulation, Worker};
use crate::cost::{Candidates, Cost, DifferentiableCost};
use crate::error::PlanError;
use crate::mpc::{ActionMap, Moment};
use crate::settings::Validate as _;

pub use self::options::{Aggregate, SimulatorOptions};

/// Candidates that a thread takes at a time: few, so that threads end together, but not one, which short roll-outs
/// would spend on taking.
const TAKE: usize = 4;
/// Actions of one plan whose slopes a thread finds at a time: the way to them is simulated once.
const RUN: usize = 4;

/// The task cost of an environment after carrying a plan out in it, by the environment's own simulation.
///
/// It forks the environment through `snapshot` and `restore` into instances of its own, one per thread, that draw no
/// images. A roll-out that diverges costs infinity.
pub struct SimulatorCost {
    entry: EnvEntry,
    config: EnvConfig,
    options: SimulatorOptions,
    workers: Vec<Worker>,
    /// `[B]`: where each row starts.
    starts: Vec<EnvState>,
    map: Option<Arc<ActionMap>>,
    /// Bits of costs or slopes, so that any thread can write any of them.
    results: Vec<AtomicU64>,
    /// Looked at before each iteration.
    cancel: Option<Cancel>,
}

impl SimulatorCost {
    /// For environments made by `entry` with `config`; images in it are left out.
    ///
    /// # Errors
    ///
    /// An option is out of range, or the environment cannot be made.
    pub fn new(entry: &EnvEntry, config: &EnvConfig, options: SimulatorOptions) -> Result<Self, PlanError> {
        options.validate()?;
        let config = EnvConfig { image: None, settings: config.settings.clone() };
        let (starts, results) = (Vec::new(), Vec::new());
        let mut cost = Self {
            entry: *entry,
            config,
            options,
            workers: Vec::new(),
            starts,
            map: None,
            results,
            cancel: None,
        };
        cost.hire(1)?;
        Ok(cost)
    }

    /// What one action may be.
    pub fn action_space(&self) -> &Space {
        self.workers[0].action_space()
    }

    /// Makes environments until there are `count`.
    fn hire(&mut self, count: usize) -> Result<(), PlanError> {
        while self.workers.len() < count {
            self.workers.push(Worker::new(self.entry.make(&self.config)?));
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
        self.cancel = moment.view().cancel().cloned();
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        if self.cancel.as_ref().is_some_and(Cancel::is_cancelled) {
            return Err(PlanError::Cancelled);
        }
        let Self { entry, options, workers, starts, map, results, .. } = self;
        let simulation = simulation(entry, options, map.as_deref(), starts, candidates)?;
        let results = results_for(results, costs.len());
        share(workers, costs.len(), TAKE, |worker, index| {
            let start = &starts[index / candidates.samples];
            let cost = worker.roll_out(&simulation, start, candidates.plan(index))?;
            results[index].store(cost.to_bits(), Ordering::Relaxed);
            Ok(())
        })?;
        costs.iter_mut().zip(results).for_each(|(cost, bits)| *cost = f64::from_bits(*bits.get_mut()));
        Ok(())
    }

    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        Some(self)
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.options.changed()
    }
}

impl DifferentiableCost for SimulatorCost {
    /// Gradients by central differences (for integers: by trying every other category), of the cost without its success
    /// bonus. All moved actions of all candidates are rolled out in parallel, from where they begin to differ.
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        self.evaluate(candidates, costs)?;
        let Self { entry, options, workers, starts, map, results, .. } = self;
        let simulation = simulation(entry, options, map.as_deref(), starts, candidates)?;
        let results = results_for(results, gradient.len());
        let size = candidates.horizon * candidates.width;
        let steps = size / simulation.map.width();
        let runs = steps.div_ceil(RUN);
        share(workers, costs.len() * runs, 1, |worker, index| {
            let (candidate, run) = (index / runs, index % runs);
            let steps = run * RUN..steps.min((run + 1) * RUN);
            let (start, plan) = (&starts[candidate / candidates.samples], candidates.plan(candidate));
            let results = &results[candidate * size..][..size];
            worker.slopes(&simulation, start, plan, steps, |number, slope| {
                results[number].store(slope.to_bits(), Ordering::Relaxed);
            })
        })?;
        for (slope, bits) in gradient.iter_mut().zip(results) {
            *slope = f64::from_bits(*bits.get_mut()) as f32;
        }
        Ok(())
    }
}

/// What roll-outs of `candidates` need to know; an error if their moment was not prepared.
fn simulation<'a>(
    entry: &'a EnvEntry,
    options: &'a SimulatorOptions,
    map: Option<&'a ActionMap>,
    starts: &[EnvState],
    candidates: &Candidates<'_>,
) -> Result<Simulation<'a>, PlanError> {
    let (expected, found) = (candidates.rows, starts.len());
    let map = map.filter(|_| found >= expected);
    let map = map.ok_or(PlanError::Size { name: "prepared rows", expected, found })?;
    Ok(Simulation { env: entry.id, options, map })
}

/// Room for `count` results.
fn results_for(results: &mut Vec<AtomicU64>, count: usize) -> &mut [AtomicU64] {
    if results.len() < count {
        results.resize_with(count, AtomicU64::default);
    }
    &mut results[..count]
}
