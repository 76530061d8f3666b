//! Solvers as entries of tables, and the policies that plan with them on the true simulator.

use serde_json::{Map, Value as Json};
use swm_core::settings::Table;
use swm_core::{
    Entry, Env, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
};

use crate::error::PlanError;
use crate::mpc::{MpcPolicy, PlanConfig};
use crate::settings::{refuse_rest, take};
use crate::simulator::{SimulatorCost, SimulatorOptions};
use crate::solver::{Solver, SolverConfig};

/// One solver of a table, such as [`crate::SOLVERS`].
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct SolverEntry {
    /// Its name: `cem`.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// Its settings.
    pub settings: &'static [Setting],
    /// Former names of settings: `(old, new)`.
    pub renamed: &'static [(&'static str, &'static str)],
    /// The policy that plans with it on the true simulator.
    pub on_simulator: PolicyEntry,
    /// Whether that policy is of use: not for solvers that need a [`crate::models::ControlModel`] or single steps of a model.
    pub plans_on_simulator: bool,
    /// Whether it needs single steps of the model: [`crate::StateSteps`].
    pub needs_states: bool,
    make: MakeSolver,
}

/// Makes a solver from settings by name.
pub type MakeSolver = fn(Map<String, Json>) -> Result<Box<dyn Solver>, PlanError>;

impl SolverEntry {
    /// The entry of `S`.
    pub const fn of<S: SolverConfig>() -> Self {
        Self {
            name: S::NAME,
            summary: S::SUMMARY,
            settings: S::SETTINGS,
            renamed: S::RENAMED,
            on_simulator: on_simulator::<S>(),
            plans_on_simulator: !S::NEEDS_CONTROL_MODEL && !S::NEEDS_STATES,
            needs_states: S::NEEDS_STATES,
            make: |given| Ok(Box::new(S::from_settings(given)?)),
        }
    }

    /// Makes one from settings by name.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: unknown, of another type, or out of range.
    pub fn make(&self, given: Map<String, Json>) -> Result<Box<dyn Solver>, PlanError> {
        (self.make)(given)
    }
}

impl Entry for SolverEntry {
    const KIND: &'static str = "solver";
    const COMMAND: &'static str = "solvers";

    fn name(&self) -> &'static str {
        self.name
    }
}

const fn on_simulator<S: SolverConfig>() -> PolicyEntry {
    PolicyEntry::new(S::NAME, S::SUMMARY, make::<S>)
        .settings(AllSettings::<S>::TABLE)
        .on_true_dynamics()
        .oracle(|_, args| Some(args.clone()))
        .suits_if(plans_in::<S>)
}

/// Whether there is something to minimize, over actions that the solver can sample.
fn plans_in<S: SolverConfig>(env: &dyn Env) -> bool {
    let solver = S::from_settings(Map::new());
    env.task_cost().is_some() && solver.is_ok_and(|solver| solver.check_space(&env.spec().action).is_ok())
}

/// All arguments of the policy of one solver.
struct AllSettings<S>(std::marker::PhantomData<S>);

impl<S: SolverConfig> AllSettings<S> {
    const JOINED: &'static Table =
        &Table::of(&[S::SETTINGS, PlanConfig::SETTINGS, SimulatorOptions::SETTINGS]);
    const TABLE: &'static [Setting] = Self::JOINED.as_slice();
}

fn make<S: SolverConfig>(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
) -> Result<Box<dyn Policy>, PolicyError> {
    let given = args.parse_as::<Map<String, Json>>()?;
    let policy = assemble::<S>(context, given).map_err(|error| match error {
        PlanError::Env(error) => PolicyError::Env(error),
        error => args.wrong(error.to_string()),
    })?;
    Ok(Box::new(policy))
}

fn assemble<S: SolverConfig>(
    context: &PolicyContext<'_>,
    mut given: Map<String, Json>,
) -> Result<MpcPolicy, PlanError> {
    given.entry("frame_skip").or_insert(context.frame_skip.into());
    let solver = take::<S>(&mut given)?;
    let config = take::<PlanConfig>(&mut given)?;
    let options = take::<SimulatorOptions>(&mut given)?;
    refuse_rest(&given, AllSettings::<S>::TABLE)?;
    let cost = SimulatorCost::new(context.env, context.config, options)?;
    solver.check_space(cost.action_space())?;
    MpcPolicy::new(Box::new(solver), Box::new(cost), config)
}
