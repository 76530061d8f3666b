//! Iterative LQR: exact where the problem is what it assumes, and as good as long descent where not.

use swm_core::{Dtype, Space};
use swm_solvers::models::{ControlCost, LinearQuadratic, Navigation};
use swm_solvers::{
    Candidates, Cost as _, Descent, Ilqr, NoTrace, Outputs, Pgd, Plan, Problem, Sgd, Solver, Workspace,
};

use crate::gradients::solve;
use crate::models::Hidden;
use crate::problems::{LQ_OPTIMA, keys, nav, problem, space};

fn on_nav(solver: &dyn Solver, seeds: u64) -> Plan {
    let mut cost = ControlCost::new(Navigation::past_one_obstacle());
    solve(solver, &mut cost, (&space(), 10, 2), seeds).expect("finite costs")
}

#[test]
fn the_linear_quadratic_problem_is_solved_at_once() {
    let once = Ilqr { iterations: 1, ..Ilqr::default() };
    let mut cost = ControlCost::new(LinearQuadratic::point_mass());
    let plan = solve(&once, &mut cost, (&space(), 10, 2), 1).unwrap();
    for (cost, optimum) in plan.cost_of_returned.iter().zip(LQ_OPTIMA) {
        assert!((cost - optimum).abs() < 2e-6, "{cost} is not {optimum}");
    }
    // Two actions per block are two steps.
    let (keys, space, initial, mut blocks) = (keys([0; 4]), space(), [0.0; 80], Plan::new());
    let problem = Problem { horizon: 5, action_block: 2, ..problem(&keys, &space, &initial) };
    once.solve(&problem, &mut cost, &mut Workspace::new(), &mut NoTrace, &mut blocks).unwrap();
    assert_eq!(blocks.actions, plan.actions);
}

#[test]
fn navigation_ends_where_the_gradient_is_zero() {
    let plan = on_nav(&Ilqr { samples: 8, iterations: 300, ..Ilqr::default() }, 2);
    let descent = Descent { samples: 8, iterations: 400, ..Descent::default() };
    let slow = on_nav(&Sgd { descent, momentum: 0.9, ..Sgd::default() }, 2);
    for (episode, (fast, slow)) in plan.cost_of_returned.iter().zip(&slow.cost_of_returned).enumerate() {
        assert!(*fast <= 1.05 * slow, "{episode}: {fast} where descent finds {slow}");
        assert!((f64::from(nav(episode % 4, plan.of(episode))) - fast).abs() < 1e-4 * fast);
    }
    let candidates = Candidates { actions: &plan.actions, episodes: 8, samples: 1, horizon: 10, dim: 2 };
    let (mut costs, mut gradient) = ([0.0; 8], [0.0; 160]);
    let mut cost = ControlCost::new(Navigation::past_one_obstacle());
    let outputs = &mut Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut costs) };
    cost.evaluate(&candidates, outputs).unwrap();
    assert!(gradient.iter().all(|slope| slope.abs() < 0.02), "{gradient:?}");
}

#[test]
fn derivatives_can_be_left_out() {
    let given = on_nav(&Ilqr::default(), 1);
    for all in [false, true] {
        let mut cost = ControlCost::new(Hidden(Navigation::past_one_obstacle(), all));
        let found = solve(&Ilqr::default(), &mut cost, (&space(), 10, 2), 1).unwrap();
        for (found, given) in found.cost_of_returned.iter().zip(&given.cost_of_returned) {
            assert!((found - given).abs() < 1e-3 * given, "{found} is not {given}");
        }
    }
}

#[test]
fn bounds_are_kept_and_still_the_best_plan_is_found() {
    let space = Space::uniform_box(Dtype::F32, &[2], -0.4, 0.4);
    let mut cost = ControlCost::new(LinearQuadratic::point_mass());
    let clipped = Ilqr { clip: true, ..Ilqr::default() };
    let plan = solve(&clipped, &mut cost, (&space, 10, 2), 1).unwrap();
    let descent = Descent { samples: 1, iterations: 3000, ..Descent::default() };
    let exact = solve(&Pgd { descent, lr: 0.02, ..Pgd::default() }, &mut cost, (&space, 10, 2), 1).unwrap();
    assert!(plan.actions.iter().all(|value| value.abs() <= 0.4));
    assert!(exact.actions.iter().any(|value| value.abs() == 0.4), "bounds matter");
    for (found, exact) in plan.cost_of_returned.iter().zip(&exact.cost_of_returned) {
        assert!((found - exact).abs() < 1e-4 * exact, "{found} is not {exact}");
    }
}
