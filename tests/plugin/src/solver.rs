//! A custom solver: random shooting.

use serde_json::{Map, Value as Json};
use swm::core::{Settings as _, Space};
use swm::solvers::{
    Cost, Noise, Plan, PlanError, Problem, Solver, SolverConfig, SolverEntry, Trace, Validate, Workspace,
};

/// `shotgun`.
pub const SHOTGUN: SolverEntry = SolverEntry::of::<Shotgun>();

swm::core::settings! {
    /// Samples S plans around the initial one, once.
    pub struct Shotgun {
        /// How many plans are tried.
        pellets: usize = 500,
    }
}

impl Validate for Shotgun {
    fn validate(&self) -> Result<(), PlanError> {
        match self.pellets {
            0 => Err(PlanError::setting("pellets", "use 1 or more")),
            _ => Ok(()),
        }
    }
}

impl SolverConfig for Shotgun {
    const NAME: &'static str = "shotgun";
    const SUMMARY: &'static str = "try many plans at random and take the cheapest";
}

impl Solver for Shotgun {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn changed_settings(&self) -> Map<String, Json> {
        self.changed()
    }

    fn check(&self, _space: &Space) -> Result<(), PlanError> {
        self.validate()
    }

    fn solve(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        _workspace: &mut Workspace,
        _trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        problem.check()?;
        problem.check_samples(self.pellets)?;
        plan.begin(problem, 1.0);
        let (size, noise) = (problem.plan_size(), Noise { purpose: Self::NAME, seed: 0 });
        let mut plans = Vec::with_capacity(problem.keys.len() * self.pellets * size);
        for (key, initial) in problem.keys.iter().zip(problem.initial.chunks_exact(size)) {
            for sample in 0..self.pellets as u32 {
                let start = plans.len();
                plans.resize(start + size, 0.0);
                noise.fill(key, 0, sample, &mut plans[start..]);
                plans[start..].iter_mut().zip(initial).for_each(|(number, center)| *number += center);
            }
        }
        let mut costs = vec![0.0; problem.keys.len() * self.pellets];
        cost.evaluate(&problem.candidates(&plans, self.pellets), &mut costs)?;
        for (row, costs) in costs.chunks_exact(self.pellets).enumerate() {
            plan.iterations[row] = 1;
            plan.non_finite[row] = costs.iter().filter(|cost| !cost.is_finite()).count() as u64;
            let finite = costs.iter().enumerate().filter(|(_, cost)| cost.is_finite());
            let Some((best, &cost)) = finite.min_by(|a, b| a.1.total_cmp(b.1)) else { continue };
            let chosen = &plans[(row * self.pellets + best) * size..][..size];
            plan.actions[row * size..][..size].copy_from_slice(chosen);
            plan.cost_of_returned[row] = cost;
        }
        Ok(())
    }
}
