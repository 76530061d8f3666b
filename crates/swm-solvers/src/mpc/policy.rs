//! Planning as a policy of a world.

use std::any::Any;

use serde_json::Map;
use swm_core::settings::describe;
use swm_core::{Actions, Field, Policy, PolicyError, Settings as _, Space, View};

use super::config::PlanConfig;
use super::planner::Planner;
use crate::context::{ActionMap, ActionScale};
use crate::cost::Cost;
use crate::error::PlanError;
use crate::solver::Solver;
use crate::trace::Trace;

/// Plans with a solver and a cost, executes R blocks, and plans again.
///
/// All its state belongs to an episode and is cleared when the next one begins. Environments whose episode is over are
/// never planned for.
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{EnvConfig, Rollout, World, WorldOptions};
/// use swm_solvers::{Cem, MpcPolicy, PlanConfig, SimulatorCost, SimulatorOptions};
///
/// // Plans on the environment's true dynamics; any other `Cost` can replace it.
/// let cost = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default())?;
/// let solver = Cem { samples: 30, iterations: 5, elites: 5, ..Cem::default() };
/// let config = PlanConfig { horizon: 5, receding_horizon: 1, action_block: 1, ..PlanConfig::default() };
/// let mut world = World::new(&TOY, WorldOptions::default().max_episode_steps(20))?;
/// world.set_policy(MpcPolicy::new(Box::new(solver), Box::new(cost), config)?)?;
///
/// let rollout = Rollout::new(0..4).seed(42);
/// assert_eq!(world.evaluate(&rollout)?.success_rate, 100.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct MpcPolicy {
    planner: Planner,
    cost: Box<dyn Cost>,
}

/// The planner of a policy that plans: on the true dynamics, or on a model of any crate.
pub fn planner_of(policy: &mut dyn Policy) -> Option<&mut MpcPolicy> {
    policy.as_any()?.downcast_mut()
}

impl MpcPolicy {
    /// A policy that minimizes `cost` with `solver`: `config.horizon` blocks of `config.action_block` actions, of which
    /// `config.receding_horizon` are executed before it plans again.
    ///
    /// # Errors
    ///
    /// A setting of `config` is 0, or more blocks would be executed than are planned.
    pub fn new(solver: Box<dyn Solver>, cost: Box<dyn Cost>, config: PlanConfig) -> Result<Self, PlanError> {
        Ok(Self { planner: Planner::new(solver, config)?, cost })
    }

    /// Plans in units of `scale`: those that the model of the cost was trained with. Without it, plans are in the units
    /// of the environment.
    #[must_use]
    pub fn with_scale(mut self, scale: ActionScale) -> Self {
        self.planner.scale = Some(scale);
        self
    }

    /// Reports every plan to `trace`. Plans do not change.
    #[must_use]
    pub fn with_trace(mut self, trace: impl Trace + 'static) -> Self {
        self.set_trace(trace);
        self
    }

    /// As [`MpcPolicy::with_trace`], of a policy that is in use.
    pub fn set_trace(&mut self, trace: impl Trace + 'static) {
        self.planner.trace = Box::new(trace);
    }

    /// How long plans are and how much of each is executed.
    pub fn config(&self) -> &PlanConfig {
        &self.planner.config
    }

    /// The map from values of its plans to actions of `space`.
    ///
    /// # Errors
    ///
    /// As of [`ActionMap::scaled`], where the policy has a scale.
    pub fn actions(&self, space: &Space) -> Result<ActionMap, PlanError> {
        self.planner.actions(space)
    }
}

impl Policy for MpcPolicy {
    fn describe(&self) -> String {
        let Planner { solver, config, .. } = &self.planner;
        let mut settings = Map::new();
        for part in [solver.changed_settings(), config.changed(), self.cost.changed_settings()] {
            settings.extend(part);
        }
        describe(solver.name(), &settings)
    }

    fn fields(&self) -> Vec<Field> {
        self.planner.config.report.fields()
    }

    fn as_any(&mut self) -> Option<&mut dyn Any> {
        Some(self)
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        let Self { planner, cost } = self;
        let report = planner.config.report;
        planner
            .plan(cost.as_mut(), view, &mut |slots, plan, time| report.write(slots, plan, time, actions))?;
        for index in view.live() {
            planner.take(index, |map, values| map.write(values, &mut actions.row(index)));
        }
        Ok(())
    }
}
