//! Solvers that learn a covariance: what it is good for, and what they refuse.

use serde_json::json;
use swm_core::{Dtype, Space};
use swm_solvers::{
    Cem, CmaEs, FullCem, NoTrace, Plan, PlanError, Problem, SOLVERS, Solver, Validate as _, Workspace,
};

use crate::problems::{Analytic, PlanCost, keys, lq, problem, space};

fn plan(solver: &dyn Solver, cost: PlanCost) -> Plan {
    let (keys, space, mut plan) = (keys(0..4), space(), Plan::new());
    let problem = problem(&keys, &space, &[0.0; 80]);
    solver
        .solve(&problem, &mut Analytic::new(cost, 30), &mut Workspace::new(), &mut NoTrace, &mut plan)
        .expect("finite costs");
    plan
}

/// A narrow valley across all values of a plan: they must be nearly equal to each other, and come near to 2.
fn valley(_: usize, plan: &[f32]) -> f32 {
    let steps: f32 = plan.windows(2).map(|pair| (pair[0] - pair[1]).powi(2)).sum();
    steps * 100.0 + plan.iter().map(|value| (value - 2.0).powi(2)).sum::<f32>()
}

#[test]
fn a_covariance_finds_the_end_of_a_valley_that_variances_do_not() {
    let worst = |plan: &Plan| plan.cost_of_returned.iter().copied().fold(0.0, f64::max);
    let best = |plan: &Plan| plan.cost_of_returned.iter().copied().fold(f64::INFINITY, f64::min);
    let alone = best(&plan(&Cem { iterations: 60, ..Cem::default() }, valley));
    let full = worst(&plan(&FullCem { iterations: 60, alpha: 0.5, ..FullCem::default() }, valley));
    let strategy = worst(&plan(&CmaEs::default(), valley));
    assert!(full < 0.7 * alone && strategy < 1e-3 * alone, "{alone}, {full}, {strategy}");
}

#[test]
fn cma_es_depends_on_the_order_of_costs_alone() {
    fn bent(instance: usize, plan: &[f32]) -> f32 {
        (1.0 + lq(instance, plan)).sqrt()
    }
    let solver = CmaEs { iterations: 20, ..CmaEs::default() };
    assert_eq!(plan(&solver, lq).actions, plan(&solver, bent).actions);
}

#[test]
fn without_a_share_of_covariance_the_search_is_along_the_axes() {
    let diagonal = FullCem { shrinkage: 1.0, alpha: 0.0, ..FullCem::default() };
    let (full, alone) = (plan(&diagonal, lq), plan(&Cem::default(), lq));
    for (full, alone) in full.cost_of_returned.iter().zip(&alone.cost_of_returned) {
        assert!((full / alone - 1.0).abs() < 0.05, "other noise, the same method: {full}, {alone}");
    }
}

#[test]
fn a_flat_cost_and_a_search_that_collapses_leave_finite_plans() {
    // One number of the plan decides, and is found to the last bit; the rest are free.
    fn first(_: usize, plan: &[f32]) -> f32 {
        (plan[0] - 0.5).abs()
    }
    for entry in SOLVERS.iter().filter(|entry| ["full-cem", "cma-es"].contains(&entry.name)) {
        let longer = json!({"samples": 40, "iterations": 500});
        let mut given = longer.as_object().expect("an object").clone();
        if entry.name == "full-cem" {
            given.insert("elites".to_owned(), 4.into());
        }
        let solver = entry.make(given).expect("valid settings");
        for cost in [first as PlanCost, |_, _| 1.0] {
            let plan = plan(solver.as_ref(), cost);
            assert!(plan.actions.iter().chain(&plan.std).all(|value| value.is_finite()), "{}", entry.name);
        }
        let found = plan(solver.as_ref(), first);
        assert!(found.cost_of_returned.iter().all(|&cost| cost < 1e-3), "{}: {found:?}", entry.name);
    }
}

#[test]
fn plans_that_are_too_long_for_a_covariance_are_refused() {
    let (keys, space) = (keys([0]), Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0));
    let problem = Problem { horizon: 505, ..problem(&keys, &space, &[0.0; 1010]) };
    for solver in [&FullCem::default() as &dyn Solver, &CmaEs::default()] {
        let mut cost = Analytic::new(lq, 30);
        let error = solver
            .solve(&problem, &mut cost, &mut Workspace::new(), &mut NoTrace, &mut Plan::new())
            .unwrap_err();
        let expected = "setting `horizon`: plans of 1010 values have a covariance of 1010 × 1010";
        assert!(error.to_string().starts_with(expected), "{error}");
    }
}

#[test]
fn settings_out_of_range_are_named() {
    let message = |result: Result<(), PlanError>| result.unwrap_err().to_string();
    let share = FullCem { shrinkage: 1.5, ..FullCem::default() };
    assert_eq!(message(share.validate()), "setting `shrinkage`: 1.5 is not a number from 0 to 1");
    let elites = FullCem { elites: 400, ..FullCem::default() };
    assert!(message(elites.validate()).starts_with("setting `elites`: 400 of 300 samples"));
    let few = CmaEs { samples: 3, ..CmaEs::default() };
    assert!(message(few.validate()).starts_with("setting `samples`: 3 is too few"));
    let sigma = CmaEs { sigma: 0.0, ..CmaEs::default() };
    assert_eq!(
        message(sigma.validate()),
        "setting `sigma`: 0 is not a positive number; use a number above 0"
    );
}
