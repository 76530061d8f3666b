//! Planning within constraints: known optima and multipliers, obstacles that are not touched.

use swm_core::{Dtype, Space};
use swm_solvers::models::{ControlCost, Navigation, Obstacle, Obstacles};
use swm_solvers::{
    Adam, Candidates, Cost, Descent, Lagrangian, NoTrace, Optimizer, Outputs, Penalty, Plan, PlanError,
    Problem, Solver as _, Workspace,
};

use crate::gradients::solve;
use crate::problems::{keys, space};

const WISHES: [f32; 4] = [0.5, 2.0, -1.0, 1.5];
const LIMITS: [f32; 4] = [1.0, 1.0, -2.0, 1.2];

/// |u - a|² where u ≤ c.
struct Capped;

impl Cost for Capped {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, constraints, weights } = outputs;
        for (index, (plan, cost)) in candidates.plans().zip(costs.iter_mut()).enumerate() {
            *cost = plan.iter().zip(WISHES).map(|(u, a)| f64::from(u - a).powi(2)).sum();
            let (mut values, mut weighed) = ([0.0; 4], [0.0; 4]);
            values.iter_mut().zip(plan).zip(LIMITS).for_each(|((g, u), c)| *g = f64::from(u - c));
            if let Some(constraints) = constraints {
                constraints[4 * index..][..4].copy_from_slice(&values);
                weights.iter().for_each(|weights_of| weights_of(index, &values, &mut weighed));
            }
            let Some(gradient) = gradient else { continue };
            let gradient = gradient[4 * index..][..4].iter_mut().zip(plan);
            for (((g, u), a), weight) in gradient.zip(WISHES).zip(weighed) {
                *g = 2.0 * (u - a) + weight as f32;
            }
        }
        Ok(())
    }
    fn has_gradients(&self) -> bool {
        true
    }
    fn constraints(&self, horizon: usize, dim: usize) -> usize {
        horizon * dim
    }
}

fn capped(solver: &Lagrangian, memory: &[Vec<f64>]) -> Plan {
    let (keys, space) = (keys([3]), Space::uniform_box(Dtype::F32, &[1], -9.0, 9.0));
    let problem =
        Problem { keys: &keys, horizon: 4, action_block: 1, action: &space, initial: &[0.0; 4], memory };
    let mut plan = Plan::new();
    solver
        .solve(&problem, &mut Capped, &mut Workspace::new(), &mut NoTrace, &mut plan)
        .expect("finite costs");
    plan
}

fn lagrangian(samples: usize, iterations: usize, rounds: usize) -> Lagrangian {
    let descent = Descent { samples, iterations, ..Descent::default() };
    // A constant penalty: one that grows wants ever shorter steps.
    let optimizer = Optimizer::Sgd;
    Lagrangian {
        descent,
        rounds,
        optimizer,
        lr: 0.02,
        rho_init: 4.0,
        rho_scale: 1.0,
        ..Lagrangian::default()
    }
}

#[test]
fn caps_are_kept_and_their_prices_known() {
    let plan = capped(&lagrangian(3, 200, 12), &[]);
    for (index, &u) in plan.actions.iter().enumerate() {
        let expected = WISHES[index].min(LIMITS[index]);
        assert!((u - expected).abs() < 1e-3, "{index}: {u} is not {expected}");
        let price = f64::from(2.0 * (WISHES[index] - LIMITS[index])).max(0.0);
        assert!((plan.memory[0][index] - price).abs() < 1e-2, "{index}: {:?}", plan.memory);
    }
    assert!(plan.violation[0].abs() < 1e-3);
    assert!((plan.cost_of_returned[0] - (1.0 + 1.0 + 0.09)).abs() < 1e-2);

    // The reference's form heads for the same point.
    let reference = Lagrangian { form: Penalty::Reference, ..lagrangian(1, 200, 12) };
    let plan = capped(&reference, &[]);
    for (index, &u) in plan.actions.iter().enumerate() {
        let expected = WISHES[index].min(LIMITS[index]);
        assert!((u - expected).abs() < 1e-2, "{index}: {u} is not {expected}");
    }
}

#[test]
fn prices_are_remembered_unless_told_otherwise() {
    let long = capped(&lagrangian(1, 200, 12), &[]);
    let short = lagrangian(1, 200, 1);
    let (cold, warm) = (capped(&short, &[]), capped(&short, &long.memory));
    assert!(cold.violation[0] > 0.1 && warm.violation[0] < 1e-2, "{:?} {:?}", cold.violation, warm.violation);
    let forgetful = Lagrangian { persist: false, ..short };
    let plan = capped(&forgetful, &long.memory);
    assert_eq!((&plan.actions, plan.memory[0].len()), (&cold.actions, 0));
}

#[test]
fn without_constraints_it_is_restarted_descent() {
    let descent = Descent { samples: 8, iterations: 20, ..Descent::default() };
    let mut cost = ControlCost::new(Navigation::past_one_obstacle());
    let one = Lagrangian { descent: descent.clone(), rounds: 1, ..Lagrangian::default() };
    let one = solve(&one, &mut cost, (&space(), 10, 2), 1).unwrap();
    let adam = solve(&Adam { descent, ..Adam::default() }, &mut cost, (&space(), 10, 2), 1).unwrap();
    // The first starts are the same; others have noise of their own.
    assert_eq!(one.violation, [f64::NEG_INFINITY; 4]);
    for (one, adam) in one.cost_of_returned.iter().zip(&adam.cost_of_returned) {
        assert!((one - adam).abs() < 0.3 * adam);
    }
    let single = Descent { samples: 1, iterations: 20, ..Descent::default() };
    let one = Lagrangian { descent: single.clone(), rounds: 1, ..Lagrangian::default() };
    let one = solve(&one, &mut cost, (&space(), 10, 2), 1).unwrap();
    let adam = Adam { descent: single, ..Adam::default() };
    assert_eq!(one.actions, solve(&adam, &mut cost, (&space(), 10, 2), 1).unwrap().actions);
}

#[test]
fn ways_lead_around_obstacles() {
    let model = Navigation {
        obstacles: vec![
            Obstacle { center: [0.55, 0.45], radius: 0.3 },
            Obstacle { center: [0.1, -0.35], radius: 0.2 },
            Obstacle { center: [-0.4, 0.2], radius: 0.2 },
        ],
        obstacles_are: Obstacles::Constraints,
        ..Navigation::past_one_obstacle()
    };
    let mut cost = ControlCost::new(model.clone());
    let descent = Descent { samples: 16, iterations: 80, track_best: true, ..Descent::default() };
    let solver = Lagrangian { descent, rounds: 8, lr: 0.05, ..Lagrangian::default() };
    let plan = solve(&solver, &mut cost, (&space(), 10, 2), 2).unwrap();
    let free = solve(&solver, &mut unconstrained(&model), (&space(), 10, 2), 2).unwrap();
    for episode in 0..8 {
        let (clearance, end) = walk(&model, episode, plan.of(episode));
        assert!(clearance >= -5e-3, "way {episode} touches an obstacle by {clearance}");
        assert!(end < 0.4, "way {episode} ends {end} from the goal");
        assert!(plan.violation[episode] <= solver.tolerance);
        assert!(
            plan.cost_of_returned[episode] >= free.cost_of_returned[episode] - 1e-2,
            "obstacles are no help"
        );
    }
    assert!(
        (0..4).any(|episode| walk(&model, episode, free.of(episode)).0 < 0.0),
        "they do stand in the way"
    );
}

fn unconstrained(model: &Navigation) -> ControlCost<Navigation> {
    ControlCost::new(Navigation { obstacles: Vec::new(), ..model.clone() })
}

/// Distance of the places of a walk from the nearest obstacle, and of its end from the goal.
fn walk(model: &Navigation, episode: usize, plan: &[f32]) -> (f64, f64) {
    let [mut place, goal] = model.ways[episode % 4];
    let mut clearance = f64::INFINITY;
    for action in plan.chunks_exact(2) {
        for (place, &u) in place.iter_mut().zip(action) {
            *place += model.stride * f64::from(u).tanh();
        }
        for obstacle in &model.obstacles {
            let [x, y] = obstacle.center;
            clearance = clearance.min((place[0] - x).hypot(place[1] - y) - obstacle.radius);
        }
    }
    (clearance, (place[0] - goal[0]).hypot(place[1] - goal[1]))
}

#[test]
fn a_feasible_plan_comes_before_a_cheaper_one() {
    // No time to become feasible from the initial plan at 3; some of the other starts are.
    let (keys, space) = (keys(0..8), Space::uniform_box(Dtype::F32, &[1], -9.0, 9.0));
    let initial = [[0.5, 1.05, -2.0, 1.25]; 8].concat();
    let problem =
        Problem { keys: &keys, horizon: 4, action_block: 1, action: &space, initial: &initial, memory: &[] };
    let descent = Descent { samples: 64, iterations: 1, sigma: 0.3, ..Descent::default() };
    let solver = Lagrangian { descent, rounds: 1, lr: 1e-6, ..Lagrangian::default() };
    let mut plan = Plan::new();
    solver.solve(&problem, &mut Capped, &mut Workspace::new(), &mut NoTrace, &mut plan).unwrap();
    for episode in 0..8 {
        assert!(plan.violation[episode] <= solver.tolerance, "{:?}", plan.violation);
    }
    let strict = Lagrangian { tolerance: 0.0, ..solver };
    strict.solve(&problem, &mut Capped, &mut Workspace::new(), &mut NoTrace, &mut plan).unwrap();
    assert!(plan.violation.iter().all(|&violation| violation <= 0.0));
}
