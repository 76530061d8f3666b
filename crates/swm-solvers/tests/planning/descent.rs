//! What solvers that follow gradients promise beside plans: options that do what they say, costs and gradients that are
//! not finite kept out, clear errors.

use swm_core::{Dtype, Space};
use swm_solvers::models::{ControlCost, LinearQuadratic, Navigation};
use swm_solvers::{
    Adam, AdamW, Candidates, Cost, Descent, DifferentiableCost, GradClip, Ilqr, Lagrangian, Pgd, Plan,
    PlanError, PlanningContext, Sgd, Solver,
};

use crate::gradients::solve;
use crate::problems::{LQ_OPTIMA, space};

fn on_lq(solver: &dyn Solver) -> Plan {
    // Wide enough for the optimum, which the usual bounds exclude.
    let space = Space::uniform_box(Dtype::F32, &[2], -4.0, 4.0);
    let mut cost = ControlCost::new(LinearQuadratic::point_mass());
    solve(solver, &mut cost, (&space, 10, 2), 1).expect("finite costs")
}

fn descent(samples: usize, iterations: usize) -> Descent {
    Descent { samples, iterations, ..Descent::default() }
}

#[test]
fn every_solver_comes_within_a_hundredth_of_the_best_plan() {
    let descent = descent(1, 300);
    let solvers: [&dyn Solver; 6] = [
        &Sgd { descent: descent.clone(), lr: 0.01, momentum: 0.9, ..Sgd::default() },
        &Adam { descent: descent.clone(), lr: 0.05, ..Adam::default() },
        &AdamW { descent: descent.clone(), lr: 0.05, weight_decay: 0.001, ..AdamW::default() },
        &Pgd { descent: descent.clone(), lr: 0.02, ..Pgd::default() },
        &Lagrangian { descent, rounds: 1, lr: 0.05, ..Lagrangian::default() },
        &Ilqr::default(),
    ];
    for solver in solvers {
        let plan = on_lq(solver);
        for (cost, optimum) in plan.cost_of_returned.iter().zip(LQ_OPTIMA) {
            assert!(*cost >= optimum - 1e-4, "{}: {cost} is below the optimum", solver.name());
            assert!(*cost <= 1.01 * optimum, "{}: {cost} of {optimum}", solver.name());
        }
    }
}

#[test]
fn a_longest_gradient_bounds_the_step() {
    let step = |mode, seeds| {
        let descent = Descent { grad_clip: 0.1, grad_clip_mode: mode, ..descent(1, 1) };
        let sgd = Sgd { descent, lr: 1.0, ..Sgd::default() };
        let mut cost = ControlCost::new(LinearQuadratic::point_mass());
        solve(&sgd, &mut cost, (&space(), 10, 2), seeds).expect("finite costs")
    };
    let length = |plan: &[f32]| plan.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>().sqrt();
    let each = step(GradClip::Sequence, 1);
    assert!((0..4).all(|episode| (length(each.of(episode)) - 0.1).abs() < 1e-6));
    assert_eq!(each.of(0), step(GradClip::Sequence, 3).of(0));
    let all = step(GradClip::Global, 1);
    assert!((length(&all.actions) - 0.1).abs() < 1e-6);
    assert_ne!(all.of(0), step(GradClip::Global, 3).of(0), "as in the reference, neighbors matter");
}

#[test]
fn the_best_of_all_steps_is_kept_on_request() {
    // Steps so long that they lead away again.
    let wild = |track_best| {
        let descent = Descent { track_best, ..descent(4, 12) };
        on_lq(&Adam { descent, lr: 1.0, ..Adam::default() })
    };
    let (last, best) = (wild(false), wild(true));
    for episode in 0..4 {
        assert!(best.cost_of_returned[episode] <= last.cost_of_returned[episode]);
    }
    assert!((0..4).any(|episode| best.cost_of_returned[episode] < last.cost_of_returned[episode]));
    let mut cost = ControlCost::new(LinearQuadratic::point_mass());
    let candidates = Candidates { actions: &best.actions, episodes: 4, samples: 1, horizon: 10, dim: 2 };
    let mut costs = [0.0; 4];
    cost.evaluate(&candidates, &mut costs).unwrap();
    assert_eq!(costs, *best.cost_of_returned, "the cost is that of the plan");
}

#[test]
fn plans_stay_within_bounds_on_request() {
    let run = |clip| {
        let adam = Adam { descent: descent(8, 50), clip, ..Adam::default() };
        let mut cost = ControlCost::new(LinearQuadratic::point_mass());
        solve(&adam, &mut cost, (&space(), 10, 2), 1).expect("finite costs")
    };
    assert!(run(false).actions.iter().any(|value| value.abs() > 1.0));
    assert!(run(true).actions.iter().all(|value| value.abs() <= 1.0));
}

/// Σ u² / 2, with a trap: where the first number is above `limit`, cost or gradient are not finite.
struct Trap {
    limit: f32,
    in_gradient: bool,
}

impl Cost for Trap {
    fn prepare(&mut self, _context: &PlanningContext<'_>) -> Result<(), PlanError> {
        Ok(())
    }
    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        for (plan, cost) in candidates.plans().zip(costs) {
            let caught = plan[0] > self.limit && !self.in_gradient;
            *cost = if caught { f64::NAN } else { plan.iter().map(|&u| f64::from(u * u) / 2.0).sum() };
        }
        Ok(())
    }
    fn differentiable(&mut self) -> Option<&mut dyn DifferentiableCost> {
        Some(self)
    }
}

impl DifferentiableCost for Trap {
    fn evaluate_with_gradient(
        &mut self,
        candidates: &Candidates<'_>,
        costs: &mut [f64],
        gradient: &mut [f32],
    ) -> Result<(), PlanError> {
        gradient.copy_from_slice(candidates.actions);
        for (plan, gradient) in candidates.plans().zip(gradient.chunks_exact_mut(20)) {
            if plan[0] > self.limit && self.in_gradient {
                gradient[7] = f32::INFINITY;
            }
        }
        self.evaluate(candidates, costs)
    }
}

#[test]
fn what_is_not_finite_stops_and_is_counted() {
    let descent = descent(64, 40);
    let solvers: [&dyn Solver; 3] = [
        &Sgd { descent: descent.clone(), lr: 0.1, ..Sgd::default() },
        &Adam { descent: descent.clone(), ..Adam::default() },
        &Lagrangian { descent, rounds: 1, ..Lagrangian::default() },
    ];
    for solver in solvers {
        for in_gradient in [false, true] {
            let mut trap = Trap { limit: 0.5, in_gradient };
            let plan = solve(solver, &mut trap, (&space(), 10, 2), 1).unwrap();
            assert!(plan.non_finite.iter().all(|&count| count > 5 && count < 60), "{:?}", plan.non_finite);
            assert!(plan.actions.iter().all(|value| value.is_finite()) && plan.of(0)[0] <= 0.5);
            let mut everywhere = Trap { limit: f32::NEG_INFINITY, in_gradient };
            let error = solve(solver, &mut everywhere, (&space(), 10, 2), 1).unwrap_err();
            assert!(
                error.to_string().starts_with("episode 0, plan 0, iteration 0: all 64 candidates"),
                "{error}"
            );
        }
    }
}

/// A cost without gradients.
struct Flat;

impl Cost for Flat {
    fn prepare(&mut self, _context: &PlanningContext<'_>) -> Result<(), PlanError> {
        Ok(())
    }
    fn evaluate(&mut self, _candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        costs.fill(0.0);
        Ok(())
    }
}

#[test]
fn costs_that_lack_what_a_solver_needs_are_refused() {
    let message =
        |solver: &dyn Solver| solve(solver, &mut Flat, (&space(), 10, 2), 1).unwrap_err().to_string();
    let solvers: [&dyn Solver; 5] =
        [&Sgd::default(), &Adam::default(), &AdamW::default(), &Pgd::default(), &Lagrangian::default()];
    for solver in solvers {
        let expected = format!("{} needs a gradient of the cost, and this cost has none", solver.name());
        assert!(message(solver).starts_with(&expected), "{}", message(solver));
    }
    assert!(message(&Ilqr::default()).starts_with("ilqr needs a model of states and steps"));
}

#[test]
fn bad_settings_and_problems_are_named() {
    let message = |solver: &dyn Solver| {
        let mut cost = ControlCost::new(Navigation::past_one_obstacle());
        solve(solver, &mut cost, (&space(), 10, 2), 1).unwrap_err().to_string()
    };
    let with = |descent: Descent| message(&Sgd { descent, ..Sgd::default() });
    for (message, part) in [
        (message(&Sgd { lr: f64::NAN, ..Sgd::default() }), "setting `lr`: NaN is not a positive number"),
        (message(&Adam { lr: f64::INFINITY, ..Adam::default() }), "setting `lr`: inf is too large"),
        (
            message(&Sgd { momentum: 1.0, ..Sgd::default() }),
            "setting `momentum`: 1 is not a number from 0 to 1 (excluded)",
        ),
        (message(&Adam { beta2: -0.1, ..Adam::default() }), "setting `beta2`: -0.1 is not a number from 0"),
        (message(&Adam { eps: -1.0, ..Adam::default() }), "setting `eps`: -1 is not a number from 0 on"),
        (message(&AdamW { weight_decay: -1.0, ..AdamW::default() }), "setting `weight_decay`: -1"),
        (message(&Lagrangian { rounds: 0, ..Lagrangian::default() }), "setting `rounds`: 0 is too small"),
        (message(&Lagrangian { rho_init: 0.0, ..Lagrangian::default() }), "setting `rho_init`: 0 is not"),
        (message(&Ilqr { regularization: 0.0, ..Ilqr::default() }), "setting `regularization`: 0 is not"),
        (with(Descent { samples: 0, ..Descent::default() }), "setting `samples`: 0 is too small"),
        (with(Descent { samples: 10_000_000, ..Descent::default() }), "setting `samples`: 10000000 plans"),
        (with(Descent { sigma: -1.0, ..Descent::default() }), "setting `sigma`: -1 is not"),
        (with(Descent { grad_clip: f64::NAN, ..Descent::default() }), "setting `grad_clip`: NaN is not"),
    ] {
        assert!(message.starts_with(part), "{message}");
    }
    let mut cost = ControlCost::new(Navigation::past_one_obstacle());
    let solvers: [&dyn Solver; 4] =
        [&Sgd::default(), &Pgd::default(), &Lagrangian::default(), &Ilqr::default()];
    for solver in solvers {
        let crossed = Space::Box { dtype: Dtype::F32, shape: vec![1], low: vec![1.0], high: vec![-1.0] };
        let error = solve(solver, &mut cost, (&crossed, 10, 1), 1).unwrap_err().to_string();
        assert!(error.contains("element 0 of the action has the bounds low 1 and high -1;"), "{error}");
        let wide = Space::uniform_box(Dtype::F32, &[3], -1.0, 1.0);
        let error = solve(solver, &mut cost, (&wide, 10, 3), 1).unwrap_err().to_string();
        assert!(
            error.starts_with("actions of 3 values of a plan, where the model takes actions of 2"),
            "{error}"
        );
        let error = solve(solver, &mut cost, (&space(), 0, 2), 1).unwrap_err().to_string();
        assert_eq!(error, "setting `horizon`: 0 is too small; use 1 or more");
    }
    let error = Sgd::default().check(&Space::Discrete { n: 5, start: 0 }).unwrap_err().to_string();
    assert!(error.starts_with("sgd cannot plan these actions: it needs real numbers"), "{error}");
    let none = Space::MultiDiscrete { n: vec![2, 0], start: vec![0, 0] };
    let error = Pgd::default().check(&none).unwrap_err().to_string();
    assert_eq!(error, "pgd cannot plan these actions: element 1 of the action has no categories");
}
