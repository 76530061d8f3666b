//! GRASP on models whose states are known: derivatives of its loss, goals that are reached, a wall that a straight way meets.

use swm_core::{Dtype, Space};
use swm_solvers::models::{
    ControlCost, ControlModel, GoalMse, LinearQuadratic, Navigation, Reduction, ShootingCost, Stage, Steps,
    Stepwise,
};
use swm_solvers::{
    Candidates, Cost, Descent, Grasp, NoTrace, Outputs, Plan, PlanError, Problem, Sgd, Solver, StepBatch,
    Sync, Workspace,
};

use crate::problems::{keys, problem, space};

const WAYS: [[f32; 2]; 4] = [[1.2, 1.0], [1.0, -0.8], [1.0, 0.4], [-1.0, -0.6]];

/// The squared distance of a model's last state from the goals.
fn reaching<M: ControlModel>(model: M, goals: &[&[f32]]) -> ShootingCost<Stepwise<M>> {
    let goals = goals.iter().map(|goal| goal.to_vec()).collect();
    let objective = GoalMse::new(&[], Steps::Last, Reduction::Sum);
    let model = Stepwise::new(model, goals).expect("the goals are states");
    ShootingCost::new(model, Box::new(objective), Vec::new()).expect("the objective fits the model")
}

fn walks() -> ShootingCost<Stepwise<Navigation>> {
    let goals: Vec<&[f32]> = WAYS.iter().map(|goal| &goal[..]).collect();
    reaching(Navigation::past_one_obstacle(), &goals)
}

fn solve(solver: &Grasp, cost: &mut dyn Cost, episodes: &[u64]) -> Result<Plan, PlanError> {
    let (keys, space) = (keys(episodes.iter().copied()), space());
    let (initial, mut plan) = (vec![0.0; keys.len() * 20], Plan::new());
    let problem = Problem { horizon: 10, ..problem(&keys, &space, &initial) };
    solver.solve(&problem, cost, &mut Workspace::new(), &mut NoTrace, &mut plan)?;
    Ok(plan)
}

#[test]
fn single_steps_are_those_of_the_model_and_their_gradient_that_of_differences() {
    let mut cost = walks();
    // Two blocks of two actions, each from a state of its own.
    let actions = [0.3, -0.2, 0.1, 0.5, -0.4, 0.2, 0.7, -0.1_f32];
    let (states, targets) = ([0.2, 0.1, -0.3, 0.4_f32], [1.0, 1.0, 0.0, -0.5_f32]);
    let mut run = |actions: &[f32]| {
        let (mut next, mut gradient) = ([0.0; 4], [0.0; 8]);
        let candidates = Candidates { actions, episodes: 1, samples: 1, horizon: 2, dim: 4 };
        let steps = StepBatch { candidates, states: &states, targets: &targets };
        cost.steps().unwrap().step_toward(&steps, &mut next, &mut gradient).unwrap();
        (next, gradient)
    };
    let loss = |next: [f32; 4]| -> f64 {
        next.iter().zip(&targets).map(|(value, target)| f64::from(value - target).powi(2)).sum()
    };
    let (next, gradient) = run(&actions);
    let model = Navigation::past_one_obstacle();
    for block in 0..2 {
        let mut state = [states[2 * block], states[2 * block + 1]].map(f64::from);
        for action in actions[4 * block..][..4].chunks_exact(2) {
            let (action, now) = ([action[0], action[1]].map(f64::from), state);
            model.step(&Stage { episode: 0, step: 0, state: &now, action: &action }, &mut state);
        }
        assert_eq!(state.map(|value| value as f32), next[2 * block..][..2]);
    }
    for (index, slope) in gradient.iter().enumerate() {
        let mut moved = actions;
        moved[index] += 0.01;
        let above = loss(run(&moved).0);
        moved[index] -= 0.02;
        let found = (above - loss(run(&moved).0)) / 0.02;
        assert!((found - f64::from(*slope)).abs() < 1e-3, "{index}: {slope} is not {found}");
    }
    let (mut starts, mut goals) = ([0.0; 4], [0.0; 4]);
    cost.steps().unwrap().ends(&mut starts, &mut goals).unwrap();
    assert_eq!((starts, goals), ([0.0, 0.0, 0.0, 0.3], [1.2, 1.0, 1.0, -0.8]));
    assert_eq!(cost.steps().unwrap().state_dim(), 2);
}

#[test]
fn goals_are_reached_by_either_synchronization() {
    let quick = Grasp { iterations: 90, lr: 0.05, ..Grasp::default() };
    for (solver, most) in [
        (Grasp::default(), 1e-3),
        (Grasp { sync: Sync::Gradient, sync_lr: 0.1, ..quick.clone() }, 0.1),
        (Grasp { samples: 4, ..quick }, 1e-2),
    ] {
        let plan = solve(&solver, &mut walks(), &[0, 1, 2, 3]).unwrap();
        println!("{:?}: {:?}", solver.sync, plan.cost_of_returned);
        assert!(
            plan.cost_of_returned.iter().all(|cost| *cost < most),
            "{solver:?}: {:?}",
            plan.cost_of_returned
        );
        assert_eq!((plan.iterations[0] as usize, plan.non_finite[0]), (solver.iterations, 0));
    }
    // A point mass is brought to rest: positions follow from velocities, which a single step reaches.
    let model = LinearQuadratic::point_mass();
    let mut cost = reaching(model, &[&[0.0; 4]]);
    let before = [0.0; 80];
    let candidates = Candidates { actions: &before, episodes: 4, samples: 1, horizon: 10, dim: 2 };
    let mut still = [0.0; 4];
    cost.evaluate(&candidates, &mut Outputs::new(&mut still)).unwrap();
    let plan = solve(&Grasp::default(), &mut cost, &[0, 1, 2, 3]).unwrap();
    for (found, still) in plan.cost_of_returned.iter().zip(still) {
        assert!(*found < 0.05 * still, "{found} of {still}");
    }
}

/// A point in the plane that a wall at x = 1 stops unless it is above y = 1: the straight way does not lead to a goal behind it.
struct Walled;

impl ControlModel for Walled {
    fn state_dim(&self) -> usize {
        2
    }
    fn action_dim(&self) -> usize {
        2
    }
    fn start(&self, _episode: usize, state: &mut [f64]) {
        state.fill(0.0);
    }
    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        let (x, y) = (at.state[0] + 0.4 * at.action[0].tanh(), at.state[1] + 0.4 * at.action[1].tanh());
        // As steep as a wall, and with a derivative.
        let barred = 1.0 / (1.0 + (20.0 * (at.state[1] - 1.0)).exp()) / (1.0 + (-20.0 * (x - 1.0)).exp());
        next[0] = x + barred * (0.95 - x);
        next[1] = y;
    }
    fn cost(&self, _at: &Stage<'_>) -> f64 {
        0.0
    }
}

#[test]
fn a_wall_that_stops_descent_is_passed() {
    let goal = [2.0, 0.0];
    let mut cost = reaching(Walled, &[&goal]);
    let episodes = [0, 1, 2, 3, 4, 5, 6, 7];
    let plan = solve(&Grasp { sigma: 0.5, ..Grasp::default() }, &mut cost, &episodes).unwrap();
    // Beyond the wall, if not at the goal: descent stays before it.
    let passed = plan.cost_of_returned.iter().filter(|cost| **cost < 0.5).count();
    let (keys, space, initial) = (keys(0..8), space(), [0.0; 160]);
    let problem = Problem { horizon: 10, ..problem(&keys, &space, &initial) };
    let (mut descended, descent) =
        (Plan::new(), Descent { samples: 1, iterations: 300, ..Descent::default() });
    let sgd = Sgd { descent, ..Sgd::default() };
    sgd.solve(&problem, &mut cost, &mut Workspace::new(), &mut NoTrace, &mut descended).unwrap();
    println!("grasp {:?}, descent {:?}", plan.cost_of_returned, descended.cost_of_returned);
    assert!(descended.cost_of_returned.iter().all(|cost| *cost > 0.9), "{:?}", descended.cost_of_returned);
    assert!(passed >= 2, "{:?}", plan.cost_of_returned);
}

#[test]
fn a_plan_is_the_same_alone_and_among_others() {
    let solver = Grasp { samples: 2, iterations: 60, ..Grasp::default() };
    let all: Vec<u64> = (0..8).collect();
    let together = solve(&solver, &mut walks(), &all).unwrap();
    for episode in [0, 4] {
        let alone = solve(&solver, &mut walks(), &[episode]).unwrap();
        assert_eq!(alone.of(0), together.of(episode as usize));
    }
    assert_eq!(together, solve(&solver, &mut walks(), &all).unwrap());
    assert_ne!(together.actions, solve(&Grasp { seed: 1, ..solver }, &mut walks(), &all).unwrap().actions);
}

#[test]
fn bounds_are_kept() {
    let solver = Grasp { clip: true, iterations: 60, ..Grasp::default() };
    let narrow = Space::uniform_box(Dtype::F32, &[2], -0.05, 0.05);
    let (keys, initial, mut plan) = (keys(0..4), [0.0; 80], Plan::new());
    let problem = Problem { horizon: 10, ..problem(&keys, &narrow, &initial) };
    solver.solve(&problem, &mut walks(), &mut Workspace::new(), &mut NoTrace, &mut plan).unwrap();
    assert!(plan.actions.iter().all(|value| value.abs() <= 0.05));
    let free = solve(&Grasp { clip: false, ..solver }, &mut walks(), &[0, 1, 2, 3]).unwrap();
    assert!(free.actions.iter().any(|value| value.abs() > 0.05), "bounds matter");
}

#[test]
fn costs_without_steps_and_wrong_settings_are_refused() {
    let mut without = ControlCost::new(Navigation::past_one_obstacle());
    let error = solve(&Grasp::default(), &mut without, &[0]).unwrap_err();
    assert!(error.to_string().contains("grasp needs a model that steps from any state"), "{error}");
    for (solver, name) in [
        (Grasp { lr_states: 0.0, ..Grasp::default() }, "lr_states"),
        (Grasp { noise: -1.0, ..Grasp::default() }, "noise"),
        (Grasp { sync_elites: 1, ..Grasp::default() }, "sync_elites"),
        (Grasp { sync_samples: 10, ..Grasp::default() }, "sync_elites"),
        (Grasp { samples: 0, ..Grasp::default() }, "samples"),
    ] {
        let error = solve(&solver, &mut walks(), &[0]).unwrap_err().to_string();
        assert!(error.contains(&format!("setting `{name}`")), "{error}");
    }
    // A model that fails everywhere.
    struct Broken;
    impl ControlModel for Broken {
        fn state_dim(&self) -> usize {
            1
        }
        fn action_dim(&self) -> usize {
            2
        }
        fn start(&self, _episode: usize, state: &mut [f64]) {
            state.fill(0.0);
        }
        fn step(&self, _at: &Stage<'_>, next: &mut [f64]) {
            next.fill(f64::NAN);
        }
        fn cost(&self, _at: &Stage<'_>) -> f64 {
            0.0
        }
    }
    let error = solve(&Grasp::default(), &mut reaching(Broken, &[&[1.0]]), &[3]).unwrap_err();
    assert!(matches!(error, PlanError::NoFiniteCost { episode: 3, iteration: 0, .. }), "{error}");
}
