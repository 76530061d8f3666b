//! Policies that plan on learned models, from settings by name: the solver, its settings, and those of the plan.

use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{PolicyArgs, PolicyContext, Registry, Setting, Settings as _};

use crate::context::ActionScale;
use crate::cost::Cost;
use crate::entry::SolverEntry;
use crate::error::PlanError;
use crate::executed::AsExecuted;
use crate::mpc::{MpcPolicy, PlanConfig};
use crate::settings::{refuse_rest, take, take_named};
use crate::solvers::SOLVERS;

/// The setting that names the solver.
pub const SOLVER_SETTING: Setting =
    Setting::new("solver", "A solver of `swm solvers`; its settings follow", "cem");

/// The cost of a learned model, with its requirements on plans.
#[non_exhaustive]
pub struct LearnedCost {
    /// The cost.
    pub cost: Box<dyn Cost>,
    /// k: actions of a block, as the model was trained.
    pub action_block: usize,
    /// Normalization of the actions that it was trained with; `None`: none.
    pub scale: Option<ActionScale>,
    /// Settings of the model, which the caller has taken already: for suggestions where one is misspelled.
    pub settings: &'static [Setting],
}

impl LearnedCost {
    /// A cost of plans in blocks of `action_block` actions that are not normalized.
    pub fn new(cost: Box<dyn Cost>, action_block: usize) -> Self {
        Self { cost, action_block, scale: None, settings: &[] }
    }

    /// The same, for actions normalized by `scale`.
    #[must_use]
    pub fn scaled(self, scale: Option<ActionScale>) -> Self {
        Self { scale, ..self }
    }

    /// The same, of a model with these settings.
    #[must_use]
    pub fn with_settings(self, settings: &'static [Setting]) -> Self {
        Self { settings, ..self }
    }
}

/// Takes [`SOLVER_SETTING`] out of `given` and returns the solver that it names, or `cem`: of the registry of `context`, or
/// of [`SOLVERS`].
fn solver_setting(
    context: &PolicyContext<'_>,
    given: &mut Map<String, Json>,
) -> Result<&'static SolverEntry, PlanError> {
    let name = given.shift_remove(SOLVER_SETTING.name).unwrap_or_else(|| SOLVER_SETTING.default.into());
    let name = name.as_str().map_or_else(|| name.to_string(), str::to_owned);
    let all = || context.registry.into_iter().flat_map(Registry::all).chain(SOLVERS);
    all().find(|solver: &&SolverEntry| solver.name == name).ok_or_else(|| {
        let mut names: Vec<&str> = all().map(|solver| solver.name).collect();
        names.sort_unstable();
        names.dedup();
        let meant = did_you_mean(nearest(&name, names.iter().copied()).as_deref());
        let reason = format!("unknown `{name}`{meant}; there are: {}", names.join(", "));
        PlanError::setting(SOLVER_SETTING.name, reason)
    })
}

/// A policy that plans on a learned model, whose cost gets candidates as they are executed: clipped to the bounds of the
/// actions, unless `clip_actions` is off. `given` holds [`SOLVER_SETTING`], the settings of that solver, and those of
/// [`PlanConfig`] but `action_block`, which is the model's.
///
/// # Errors
///
/// [`PlanError::Setting`]: an unknown solver, an unknown or misfit setting, or another `action_block` than the
/// model's.
pub fn plan_on(
    context: &PolicyContext<'_>,
    learned: LearnedCost,
    mut given: Map<String, Json>,
) -> Result<MpcPolicy, PlanError> {
    let solver = solver_setting(context, &mut given)?;
    let own = take_named(&mut given, solver.settings, solver.renamed)?;
    let block = learned.action_block;
    if given.get("action_block").is_some_and(|asked| asked.as_u64() != Some(block as u64)) {
        let reason = format!("the model was trained on blocks of {block}; leave it out");
        return Err(PlanError::setting("action_block", reason));
    }
    given.insert("action_block".to_owned(), block.into());
    let config = take::<PlanConfig>(&mut given)?;
    refuse_rest(
        &given,
        &[solver.settings, PlanConfig::SETTINGS, &[SOLVER_SETTING], learned.settings].concat(),
    )?;
    let policy = MpcPolicy::new(solver.make(own)?, Box::new(AsExecuted::new(learned.cost)), config)?;
    Ok(match learned.scale {
        Some(scale) => policy.with_scale(scale),
        None => policy,
    })
}

/// The arguments of the same planner on the true dynamics, the oracle of a policy that [`plan_on`] makes: the solver and
/// the settings of `given`. `None` where the solver cannot plan on the true dynamics.
pub fn on_true_dynamics(context: &PolicyContext<'_>, mut given: Map<String, Json>) -> Option<PolicyArgs> {
    let solver = solver_setting(context, &mut given).ok().filter(|solver| solver.plans_on_simulator)?;
    Some(PolicyArgs::new(solver.name, given))
}
