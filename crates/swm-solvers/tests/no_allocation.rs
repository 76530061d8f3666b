//! A solver allocates at its first solve and at no later one of the same size. Alone in this binary, because it counts
//! all allocations of the process.

#[expect(clippy::unwrap_used, dead_code, reason = "tests")]
mod problems;

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm_solvers::{Candidates, Cem, Cost, Moment, Plan, PlanError, SOLVERS, Workspace};

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// A cost that allocates nothing.
struct Free;

impl Cost for Free {
    fn prepare(&mut self, _moment: &Moment<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        for (plan, cost) in candidates.plans().zip(costs) {
            *cost = f64::from(plan[0] * plan[0]);
        }
        Ok(())
    }
}

#[test]
fn later_solves_allocate_nothing() {
    // One thread: what rayon needs to wake others is not the solver's.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        for entry in SOLVERS {
            let solver = (entry.make)(serde_json::Map::new()).unwrap();
            let keys = problems::keys(0..4);
            let (space, initial) = (problems::space(), vec![0.0; 4 * 20]);
            let problem = problems::problem(&keys, &space, &initial);
            let (mut workspace, mut plan) = (Workspace::new(), Plan::new());
            let mut solve = || solver.solve(&problem, &mut Free, &mut workspace, &mut plan).unwrap();
            let first = Region::new(COUNTED);
            solve();
            assert!(first.change().allocations > 0, "the counter counts");
            let later = Region::new(COUNTED);
            solve();
            let change = later.change();
            assert_eq!((change.allocations, change.reallocations), (0, 0), "{}", entry.name);
        }
    });
    assert_eq!(Cem::default(), serde_json::from_str("{}").unwrap());
}
