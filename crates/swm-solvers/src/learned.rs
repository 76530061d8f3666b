//! From settings by name to a policy that plans on a learned model: which solver, its settings, those of the plan.
//! What the model is, and where it comes from, is its owner's business.

use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{PolicyArgs, PolicyContext, Registry, Setting, Settings as _};

use crate::cost::Cost;
use crate::error::PlanError;
use crate::mpc::{ActionScale, MpcPolicy, PlanConfig};
use crate::settings::{refuse_rest, take, take_named};
use crate::solver::SolverEntry;
use crate::solvers::SOLVERS;

/// Which solver plans on a learned model.
pub const SOLVER_SETTING: Setting =
    Setting::new("solver", "A solver of `swm solvers`; its settings follow", "cem");

/// A model's cost, and what plans on it must be like.
pub struct LearnedCost {
    /// How good plans are.
    pub cost: Box<dyn Cost>,
    /// k: actions of a block, as the model was trained.
    pub action_block: usize,
    /// The units of the actions that it was trained with; `None`: the environment's.
    pub scale: Option<ActionScale>,
    /// The model's own settings, which its owner has taken before: they are offered beside the others where one is misspelt.
    pub settings: &'static [Setting],
}

/// Takes [`SOLVER_SETTING`] out of `given`: the solver that it names, or `cem`; of the registry that the policy is made
/// in, or of [`SOLVERS`].
fn take_solver(
    context: &PolicyContext<'_>,
    given: &mut Map<String, Json>,
) -> Result<&'static SolverEntry, PlanError> {
    let name = given.shift_remove(SOLVER_SETTING.name).unwrap_or_else(|| SOLVER_SETTING.default.into());
    let name = name.as_str().map_or_else(|| name.to_string(), str::to_owned);
    let all = || context.registry.into_iter().flat_map(Registry::all).chain(SOLVERS);
    all().find(|solver: &&SolverEntry| solver.name == name).ok_or_else(|| {
        let meant = did_you_mean(nearest(&name, all().map(|solver| solver.name)).as_deref());
        let reason = format!("unknown `{name}`{meant}; `swm solvers` lists them");
        PlanError::setting(SOLVER_SETTING.name, reason)
    })
}

/// A policy that plans on a learned model. `given` holds [`SOLVER_SETTING`], the settings of that solver, and those of
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
    let solver = take_solver(context, &mut given)?;
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
    let policy = MpcPolicy::new(solver.make(own)?, learned.cost, config)?;
    Ok(match learned.scale {
        Some(scale) => policy.with_scale(scale),
        None => policy,
    })
}

/// The arguments of the same planner on the true dynamics, the oracle of a policy that [`plan_on`] makes: the solver and
/// the settings of `given`. `None` where the solver cannot plan on the true dynamics.
pub fn on_true_dynamics(context: &PolicyContext<'_>, mut given: Map<String, Json>) -> Option<PolicyArgs> {
    let solver = take_solver(context, &mut given).ok().filter(|solver| solver.plans_on_simulator)?;
    Some(PolicyArgs::new(solver.name, given))
}
