//! A planning problem with a negligible cost, for every solver: it measures the solver itself.

use anyhow::{Context as _, Result};
use serde_json::{Map, json};
use swm_core::{Dtype, EpisodeSeed, Space};
use swm_solvers::{
    Candidates, Cost, NoTrace, Outputs, Plan, PlanError, PlanKey, PredictiveSampling, Problem, SOLVERS,
    Solver, SolverConfig as _, Workspace, plan_dim,
};

/// H: blocks of a plan.
const HORIZON: usize = 10;

/// The distance of a plan's first value from a half.
#[derive(Clone, Copy, Debug)]
pub struct FreeCost;

impl Cost for FreeCost {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        for (plan, cost) in candidates.plans().zip(costs.iter_mut()) {
            *cost = f64::from((plan[0] - 0.5).abs());
        }
        let Some(gradient) = gradient else { return Ok(()) };
        gradient.fill(0.0);
        let gradients = gradient.chunks_exact_mut(candidates.horizon * candidates.dim);
        for (plan, gradient) in candidates.plans().zip(gradients) {
            gradient[0] = (plan[0] - 0.5).signum();
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }
}

/// One solver with the settings of the comparison (300 candidates, 30 iterations, where it has such settings), and what
/// it needs to plan 10 blocks of 2 real values, or of one of 5 categories.
pub struct SolveCase {
    /// The solver's name.
    pub name: &'static str,
    solver: Box<dyn Solver>,
    action: Space,
    keys: Vec<PlanKey>,
    initial: Vec<f32>,
    workspace: Workspace,
    /// The result of the last solve.
    pub plan: Plan,
}

impl SolveCase {
    /// Every solver that can plan for [`FreeCost`], for `episodes` episodes at once.
    ///
    /// # Errors
    ///
    /// A solver without default settings.
    pub fn all(episodes: usize) -> Result<Vec<Self>> {
        let mut cases = Vec::new();
        for entry in SOLVERS {
            // Predictive sampling makes one iteration, here and in the reference.
            let iterations = if entry.name == PredictiveSampling::NAME { 1 } else { 30 };
            let wanted = [("samples", json!(300)), ("iterations", json!(iterations))];
            let known = wanted.into_iter().filter(|(name, _)| entry.settings.iter().any(|s| s.name == *name));
            let settings: Map<_, _> = known.map(|(name, value)| (name.to_owned(), value)).collect();
            let solver = entry.make(settings).with_context(|| format!("settings of {}", entry.name))?;
            let spaces =
                [Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), Space::Discrete { n: 5, start: 0 }];
            let Some(action) = spaces.into_iter().find(|space| solver.check(space).is_ok()) else {
                continue;
            };
            let key = |episode| PlanKey { episode, seed: EpisodeSeed::of(1, episode), plan: 0 };
            let mut case = Self {
                name: entry.name,
                solver,
                keys: (0..episodes as u64).map(key).collect(),
                initial: vec![0.0; episodes * HORIZON * plan_dim(&action)],
                action,
                workspace: Workspace::new(),
                plan: Plan::new(),
            };
            // A solver may need to know more of its model than a cost.
            if case.solve().is_ok() {
                cases.push(case);
            }
        }
        Ok(cases)
    }

    /// Plans once.
    ///
    /// # Errors
    ///
    /// The solver fails.
    pub fn solve(&mut self) -> Result<(), PlanError> {
        let problem = Problem {
            keys: &self.keys,
            horizon: HORIZON,
            action_block: 1,
            action: &self.action,
            initial: &self.initial,
            memory: &[],
        };
        self.solver.solve(&problem, &mut FreeCost, &mut self.workspace, &mut NoTrace, &mut self.plan)
    }
}
