//! A custom solver: random shooting.

use swm::core::Space;
use swm::solvers::{
    Cost, Noise, Outputs, Plan, PlanError, Problem, SolverConfig, SolverEntry, Trace, Validate, Workspace,
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

    fn check_space(&self, _space: &Space) -> Result<(), PlanError> {
        Ok(())
    }

    fn solve_checked(
        &self,
        problem: &Problem<'_>,
        cost: &mut dyn Cost,
        _workspace: &mut Workspace,
        _trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        problem.check_samples(self.pellets)?;
        plan.begin(problem, 1.0);
        let (size, noise) = (problem.plan_size(), Noise { purpose: Self::NAME, seed: 0 });
        let mut plans = Vec::with_capacity(problem.keys.len() * self.pellets * size);
        for (key, initial) in problem.keys.iter().zip(problem.initial.chunks_exact(size)) {
            for sample in 0..self.pellets as u32 {
                let start = plans.len();
                plans.resize(start + size, 0.0);
                noise.fill(key, 0, sample, &mut plans[start..]);
                plans[start..].iter_mut().zip(initial).for_each(|(value, center)| *value += center);
            }
        }
        let mut costs = vec![0.0; problem.keys.len() * self.pellets];
        cost.evaluate(&problem.candidates(&plans, self.pellets), &mut Outputs::new(&mut costs))?;
        for (episode, costs) in costs.chunks_exact(self.pellets).enumerate() {
            plan.iterations[episode] = 1;
            plan.non_finite[episode] = costs.iter().filter(|cost| !cost.is_finite()).count() as u64;
            let finite = costs.iter().enumerate().filter(|(_, cost)| cost.is_finite());
            let Some((best, &cost)) = finite.min_by(|a, b| a.1.total_cmp(b.1)) else { continue };
            let chosen = &plans[(episode * self.pellets + best) * size..][..size];
            plan.actions[episode * size..][..size].copy_from_slice(chosen);
            plan.cost_of_returned[episode] = cost;
        }
        Ok(())
    }
}
