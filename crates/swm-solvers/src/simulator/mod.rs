//! Planning on the true dynamics: candidates are rolled out on copies of the environment. It is the oracle that learned
//! models are compared with.

mod options;
mod parallel;
mod worker;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::{Map, Value as Json};
use swm_core::{Cancel, EnvConfig, EnvEntry, EnvState, Observations, Settings as _, Space};

use self::parallel::for_each;
use self::worker::{Simulation, Worker};
use crate::context::{ActionMap, PlanningContext};
use crate::cost::{Cost, Outputs};
use crate::error::PlanError;
use crate::problem::Candidates;
use crate::settings::Validate as _;

pub use self::options::{Aggregate, SimulatorOptions};

/// Candidates that a thread takes at a time: few, so that threads end together, but not one, whose overhead would show in
/// short rollouts.
const TAKE: usize = 4;
/// Actions of one plan whose finite differences a thread computes at a time: the steps before them are simulated once.
const RUN: usize = 4;

/// The task cost of an environment after executing a plan in it, by the environment's own simulation.
///
/// It forks the environment through `snapshot` and `restore` into its own instances, one per thread, that render no
/// images. A rollout that diverges costs infinity.
pub struct SimulatorCost {
    entry: EnvEntry,
    config: EnvConfig,
    options: SimulatorOptions,
    workers: Vec<Worker>,
    /// `[B]`: where each episode starts.
    starts: Vec<EnvState>,
    map: Option<Arc<ActionMap>>,
    /// Bits of costs or gradients, so that any thread can write any of them.
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
        cost.add_workers(1)?;
        Ok(cost)
    }

    /// The action space.
    pub fn action_space(&self) -> &Space {
        self.workers[0].action_space()
    }

    /// Makes environments until there are `count`.
    fn add_workers(&mut self, count: usize) -> Result<(), PlanError> {
        while self.workers.len() < count {
            self.workers.push(Worker::new(self.entry.make(&self.config)?));
        }
        Ok(())
    }
}

impl Cost for SimulatorCost {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let world = &context.view().spec().id;
        if world == Observations::ID {
            return Err(PlanError::NoSimulator { planner: self.entry.id.to_owned() });
        }
        if world != self.entry.id {
            let (planner, world) = (self.entry.id.to_owned(), world.clone());
            return Err(PlanError::OtherEnv { planner, world });
        }
        self.add_workers(rayon::current_num_threads())?;
        if self.starts.len() < context.len() {
            self.starts.resize_with(context.len(), EnvState::new);
        }
        for (index, start) in self.starts.iter_mut().take(context.len()).enumerate() {
            context.env(index).snapshot(start)?;
        }
        self.map = Some(Arc::clone(context.actions()));
        self.cancel = context.view().cancel().cloned();
        Ok(())
    }

    /// Gradients by central differences (for integers: by trying every other category), of the cost without its success
    /// bonus. All perturbed actions of all candidates are rolled out in parallel, from where they begin to differ.
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        if self.cancel.as_ref().is_some_and(Cancel::is_cancelled) {
            return Err(PlanError::Cancelled);
        }
        let Self { entry, options, workers, starts, map, results, .. } = self;
        let simulation = simulation(entry, options, map.as_deref(), starts, candidates)?;
        let Outputs { costs, gradient, .. } = outputs;
        let bits = results_for(results, costs.len());
        for_each(workers, costs.len(), TAKE, |worker, index| {
            let start = &starts[index / candidates.samples];
            let cost = worker.roll_out(&simulation, start, candidates.plan(index))?;
            bits[index].store(cost.to_bits(), Ordering::Relaxed);
            Ok(())
        })?;
        costs.iter_mut().zip(bits).for_each(|(cost, bits)| *cost = f64::from_bits(*bits.get_mut()));
        let Some(gradient) = gradient else { return Ok(()) };
        let bits = results_for(results, gradient.len());
        let size = candidates.horizon * candidates.dim;
        let steps = size / simulation.map.dim();
        let runs = steps.div_ceil(RUN);
        for_each(workers, costs.len() * runs, 1, |worker, index| {
            let (candidate, run) = (index / runs, index % runs);
            let steps = run * RUN..steps.min((run + 1) * RUN);
            let (start, plan) = (&starts[candidate / candidates.samples], candidates.plan(candidate));
            let bits = &bits[candidate * size..][..size];
            worker.differences(&simulation, start, plan, steps, |index, value| {
                bits[index].store(value.to_bits(), Ordering::Relaxed);
            })
        })?;
        for (value, bits) in gradient.iter_mut().zip(bits) {
            *value = f64::from_bits(*bits.get_mut()) as f32;
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.options.changed()
    }
}

/// What rollouts of `candidates` share; an error if their context was not prepared.
fn simulation<'a>(
    entry: &'a EnvEntry,
    options: &'a SimulatorOptions,
    map: Option<&'a ActionMap>,
    starts: &[EnvState],
    candidates: &Candidates<'_>,
) -> Result<Simulation<'a>, PlanError> {
    let (expected, found) = (candidates.episodes, starts.len());
    let map = map.filter(|_| found >= expected);
    let map = map.ok_or(PlanError::Size { name: "prepared episodes", expected, found })?;
    Ok(Simulation { env: entry.id, options, map })
}

/// Room for `count` results.
fn results_for(results: &mut Vec<AtomicU64>, count: usize) -> &mut [AtomicU64] {
    if results.len() < count {
        results.resize_with(count, AtomicU64::default);
    }
    &mut results[..count]
}
