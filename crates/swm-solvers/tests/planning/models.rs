//! The models that the crate offers: their costs are those of the golden problems, their gradients those of their costs,
//! and what is put together from parts is what is written down at once.

use proptest::prelude::*;
use swm_solvers::models::{
    Constraint, ControlCost, ControlModel, ControlPenalty, DiscreteChain, GoalMse, KeepAway, LinearQuadratic,
    Navigation, Objective, Obstacle, Obstacles, Path, Reduction, ShootingCost, Stage, Steps, Stepwise,
    WeightedSum,
};
use swm_solvers::{Adam, Candidates, Cem, Cost, Lagrangian, Outputs, PlanError, Solver};

use crate::gradients::solve;
use crate::problems::{self, PlanCost, disc, lq, nav};

/// The same plan for each of the four instances.
fn four(plan: &[f32], dim: usize) -> Candidates<'_> {
    Candidates { actions: plan, episodes: 4, samples: 1, horizon: plan.len() / 4 / dim, dim }
}

fn evaluate(cost: &mut dyn Cost, candidates: &Candidates<'_>) -> Vec<f64> {
    let mut costs = vec![f64::NAN; candidates.episodes * candidates.samples];
    cost.evaluate(candidates, &mut Outputs::new(&mut costs)).expect("plans of the right dimension");
    costs
}

fn gradient(cost: &mut dyn Cost, candidates: &Candidates<'_>) -> Vec<f32> {
    let mut costs = vec![f64::NAN; candidates.episodes * candidates.samples];
    let mut gradient = vec![f32::NAN; candidates.actions.len()];
    let outputs = &mut Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut costs) };
    cost.evaluate(candidates, outputs).expect("plans of the right dimension");
    assert_eq!(costs, evaluate(cost, candidates), "costs are the same with gradients and without");
    gradient
}

/// Central differences of the sum of all costs.
fn differences(cost: &mut dyn Cost, candidates: &Candidates<'_>, step: f32) -> Vec<f64> {
    let mut moved = candidates.actions.to_vec();
    let mut gradient = Vec::new();
    for (index, &value) in candidates.actions.iter().enumerate() {
        let mut at = |place: f32| {
            moved[index] = place;
            let episode = index / (candidates.horizon * candidates.dim);
            evaluate(cost, &Candidates { actions: &moved, ..*candidates })[episode]
        };
        let (low, high) = (value - step, value + step);
        gradient.push((at(high) - at(low)) / f64::from(high - low));
        moved[index] = value;
    }
    gradient
}

fn assert_near(found: &[f32], expected: &[f64], relative: f64) {
    for (index, (&found, &expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(found) - expected).abs();
        assert!(error <= relative * expected.abs().max(1.0), "{index}: {found} is not {expected}");
    }
}

fn between_obstacles(obstacles_are: Obstacles) -> Navigation {
    let obstacles = vec![
        Obstacle { center: [0.5, 0.4], radius: 0.2 },
        Obstacle { center: [-0.2, 0.3], radius: 0.3 },
        Obstacle { center: [0.1, -0.6], radius: 0.25 },
    ];
    Navigation { obstacles, obstacles_are, ..Navigation::past_one_obstacle() }
}

/// A model that hides derivatives: all but the first of its cost, or all.
pub(super) struct Hidden<M>(pub(super) M, pub(super) bool);

impl<M: ControlModel> ControlModel for Hidden<M> {
    fn state_dim(&self) -> usize {
        self.0.state_dim()
    }
    fn action_dim(&self) -> usize {
        self.0.action_dim()
    }
    fn start(&self, episode: usize, state: &mut [f64]) {
        self.0.start(episode, state);
    }
    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        self.0.step(at, next);
    }
    fn cost(&self, at: &Stage<'_>) -> f64 {
        self.0.cost(at)
    }
    fn cost_derivatives(&self, at: &Stage<'_>, by_state: &mut [f64], by_action: &mut [f64]) -> bool {
        !self.1 && self.0.cost_derivatives(at, by_state, by_action)
    }
    fn constraints(&self) -> usize {
        self.0.constraints()
    }
    fn constrain(&self, episode: usize, action: &[f64], next: &[f64], values: &mut [f64]) {
        self.0.constrain(episode, action, next, values);
    }
}

fn plans(size: usize) -> impl Strategy<Value = Vec<f32>> {
    proptest::collection::vec(-2.0_f32..2.0, 4 * size)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn costs_are_those_of_the_golden_problems(real in plans(20), mixed in plans(30)) {
        let check = |cost: &mut dyn Cost, plans: &[f32], dim, golden: PlanCost| {
            let costs = evaluate(cost, &four(plans, dim));
            for (episode, (plan, cost)) in plans.chunks_exact(plans.len() / 4).zip(costs).enumerate() {
                let golden = f64::from(golden(episode, plan));
                assert!((cost - golden).abs() <= 1e-5 * golden.abs().max(1.0), "{cost} is not {golden}");
            }
        };
        check(&mut ControlCost::new(LinearQuadratic::point_mass()), &real, 2, lq);
        check(&mut ControlCost::new(Navigation::past_one_obstacle()), &real, 2, nav);
        check(&mut ControlCost::new(DiscreteChain::quarter_steps()), &mixed, 5, disc);
    }

    #[test]
    fn gradients_are_those_of_the_costs(real in plans(20), mixed in plans(30)) {
        let check = |cost: &mut dyn Cost, candidates: &Candidates<'_>| {
            let found = gradient(cost, candidates);
            assert_near(&found, &differences(cost, candidates, 1e-2), 2e-3);
            found
        };
        let real = four(&real, 2);
        let own = check(&mut ControlCost::new(LinearQuadratic::point_mass()), &real);
        for model in [Hidden(LinearQuadratic::point_mass(), false), Hidden(LinearQuadratic::point_mass(), true)] {
            let found = gradient(&mut ControlCost::new(model), &real);
            assert_near(&found, &own.iter().map(|&value| value.into()).collect::<Vec<f64>>(), 1e-6);
        }
        check(&mut ControlCost::new(Navigation::past_one_obstacle()), &real);
        check(&mut ControlCost::new(between_obstacles(Obstacles::Penalties { weight: 3.0 })), &real);
        check(&mut ControlCost::new(DiscreteChain::quarter_steps()), &four(&mixed, 5));
        // Two actions per block.
        check(&mut ControlCost::new(Navigation::past_one_obstacle()), &four(real.actions, 4));
    }

    #[test]
    fn constraints_have_gradients(real in plans(20), weights in proptest::collection::vec(0.0..2.0, 30)) {
        let mut cost = ControlCost::new(between_obstacles(Obstacles::Constraints));
        check_constraints(&mut cost, &four(&real, 2), 30, &weights, 1e-2);
        let hidden = Hidden(between_obstacles(Obstacles::Constraints), true);
        check_constraints(&mut ControlCost::new(hidden), &four(&real, 2), 30, &weights, 1e-2);
        check_constraints(&mut composed().expect("known parts"), &four(&real, 2), 30, &weights, 1e-2);
    }

    #[test]
    fn the_whole_is_the_sum_of_its_parts(real in plans(20)) {
        let whole = Navigation { effort: 0.01, ..between_obstacles(Obstacles::Constraints) };
        let (mut whole, mut parts) = (ControlCost::new(whole), composed().expect("known parts"));
        for candidates in [four(&real, 2), four(&real, 4)] {
            let (expected, found) = (evaluate(&mut whole, &candidates), evaluate(&mut parts, &candidates));
            if candidates.dim == 2 {
                for (found, expected) in found.iter().zip(&expected) {
                    assert!((found - expected).abs() <= 1e-5 * expected.abs().max(1.0));
                }
                let expected = gradient(&mut whole, &candidates);
                let expected: Vec<f64> = expected.into_iter().map(f64::from).collect();
                assert_near(&gradient(&mut parts, &candidates), &expected, 1e-4);
            } else {
                // The parts see a state per block, the whole one per action; the gradient is still that of the cost.
                assert!(found.iter().zip(&expected).all(|(found, expected)| found < expected));
                let expected = differences(&mut parts, &candidates, 1e-2);
                assert_near(&gradient(&mut parts, &candidates), &expected, 5e-3);
            }
        }
    }
}

/// The gradient of cost + Σ w g, with w chosen when g is known, against differences of it at that w.
fn check_constraints(
    cost: &mut dyn Cost,
    candidates: &Candidates<'_>,
    count: usize,
    weights: &[f64],
    step: f32,
) {
    assert_eq!(cost.constraints(candidates.horizon, candidates.dim), count);
    let mut costs = vec![0.0; 4];
    let (mut values, mut again) = (vec![f64::NAN; 4 * count], vec![f64::NAN; 4 * count]);
    let mut gradient = vec![f32::NAN; candidates.actions.len()];
    let weights_of = |index: usize, values: &[f64], out: &mut [f64]| {
        assert_eq!(values.len(), count);
        out.iter_mut().zip(weights).for_each(|(out, weight)| *out = weight * (1.0 + index as f64));
    };
    let outputs = &mut Outputs {
        gradient: Some(&mut gradient),
        constraints: Some(&mut values),
        weights: Some(&weights_of),
        ..Outputs::new(&mut costs)
    };
    cost.evaluate(candidates, outputs).expect("plans of the right dimension");
    assert_eq!(costs, evaluate(cost, candidates));
    let outputs = &mut Outputs { constraints: Some(&mut again), ..Outputs::new(&mut costs) };
    cost.evaluate(candidates, outputs).expect("plans of the right dimension");
    assert_eq!(values, again);
    let expected = differences(&mut Weighted { cost, count, weights }, candidates, step);
    assert_near(&gradient, &expected, 5e-3);
}

/// cost + Σ w g.
struct Weighted<'a> {
    cost: &'a mut dyn Cost,
    count: usize,
    weights: &'a [f64],
}

impl Cost for Weighted<'_> {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let costs = &mut *outputs.costs;
        let mut values = vec![0.0; costs.len() * self.count];
        let constraints = Some(&mut values[..]);
        self.cost.evaluate(candidates, &mut Outputs { constraints, ..Outputs::new(costs) })?;
        for (index, (cost, values)) in costs.iter_mut().zip(values.chunks_exact(self.count)).enumerate() {
            let sum: f64 = values.iter().zip(self.weights).map(|(value, weight)| value * weight).sum();
            *cost += sum * (1.0 + index as f64);
        }
        Ok(())
    }
}

/// Navigation between three obstacles, put together from dynamics, objective and constraints.
fn composed() -> Result<ShootingCost<Stepwise<Navigation>>, PlanError> {
    let model = between_obstacles(Obstacles::Constraints);
    let goals = model.ways.iter().map(|[_, goal]| goal.iter().map(|&x| x as f32).collect()).collect();
    let all = GoalMse::new(&["state"], Steps::All, Reduction::Sum);
    // A mean over two values: twice the weight makes it a sum.
    let end = GoalMse::new(&[], Steps::Last, Reduction::Mean);
    let objective = WeightedSum::new(vec![
        (1.0, Box::new(all)),
        (10.0, Box::new(end)),
        (0.01, Box::new(ControlPenalty)),
    ])?;
    let mut constraints: Vec<Box<dyn Constraint>> = Vec::new();
    for obstacle in &model.obstacles {
        let center = obstacle.center.map(|x| x as f32);
        constraints.push(Box::new(KeepAway::new("state", &center, obstacle.radius)));
    }
    ShootingCost::new(Stepwise::new(model, goals)?, Box::new(objective), constraints)
}

#[test]
fn the_best_plans_of_the_chain_are_found_by_trying_all() {
    let chain = DiscreteChain::quarter_steps();
    for (episode, optimum) in problems::DISC_OPTIMA.into_iter().enumerate() {
        let (plan, cost) = chain.enumerate(episode, problems::DISC_HORIZON);
        assert!((cost - optimum).abs() < 1e-9, "{cost} is not {optimum}");
        let one_hot: Vec<f32> =
            plan.iter().flat_map(|&c| (0..5).map(move |i| f32::from(u8::from(i == c)))).collect();
        assert!((f64::from(disc(episode, &one_hot)) - cost).abs() < 1e-6);
        assert_eq!(chain.cost_of(episode, &plan), cost);
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    let plans: Vec<f32> = (0..37 * 20).map(|i| (i as f32 * 0.7).sin()).collect();
    let candidates = Candidates { actions: &plans, episodes: 37, samples: 1, horizon: 10, dim: 2 };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be made");
        pool.install(|| gradient(&mut ControlCost::new(Navigation::past_one_obstacle()), &candidates))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn wrong_parts_and_dimensions_are_named() {
    let model = || Stepwise::new(Navigation::past_one_obstacle(), vec![vec![0.0; 2]]).expect("two values");
    let error = |objective: GoalMse| {
        ShootingCost::new(model(), Box::new(objective), Vec::new()).err().expect("refused").to_string()
    };
    assert_eq!(
        error(GoalMse::new(&["pixels_emb"], Steps::Last, Reduction::Sum)),
        "setting `parts`: the model has no `pixels_emb`; it has state"
    );
    let wide = KeepAway::new("state", &[0.0; 3], 1.0);
    let error = ShootingCost::new(model(), Box::new(ControlPenalty), vec![Box::new(wide)]);
    assert_eq!(
        error.err().expect("refused").to_string(),
        "planning problem: `center` must hold 2 values, found 3"
    );
    assert!(WeightedSum::new(Vec::new()).is_err());
    assert!(WeightedSum::new(vec![(f64::NAN, Box::new(ControlPenalty))]).is_err());
    let odd = Candidates { actions: &[0.0; 3], episodes: 1, samples: 1, horizon: 1, dim: 3 };
    let mut cost = ControlCost::new(Navigation::past_one_obstacle());
    let error = cost.evaluate(&odd, &mut Outputs::new(&mut [0.0])).unwrap_err().to_string();
    assert!(
        error.starts_with("blocks of 3 values of a plan are no whole number of the model's actions, of 2"),
        "{error}"
    );
}

/// The distance of the last state from the goal, and a wall, with no derivatives.
struct Plain;

impl Objective for Plain {
    fn cost(&self, path: &Path<'_>) -> f64 {
        let last = &path.states[path.states.len() - path.dim..];
        last.iter().zip(path.goal).map(|(a, b)| f64::from((a - b).abs())).sum()
    }
}

impl Constraint for Plain {
    fn count(&self, _horizon: usize, _dim: usize) -> usize {
        1
    }
    fn values(&self, path: &Path<'_>, values: &mut [f64]) {
        values[0] = f64::from(path.states[0]) - 0.1;
    }
}

#[test]
fn objectives_without_derivatives_are_for_solvers_that_need_none() {
    let dynamics = || {
        let model = Navigation::past_one_obstacle();
        let goals = model.ways.iter().map(|[_, goal]| goal.map(|value| value as f32).to_vec()).collect();
        Stepwise::new(model, goals).expect("goals of 2 values")
    };
    let sampling = Cem { samples: 64, iterations: 8, elites: 8, ..Cem::default() };
    let gradients = Adam::default();
    let refusal = |cost: &mut dyn Cost, solver: &dyn Solver| {
        solve(solver, cost, (&problems::space(), 10, 2), 1).err().map(|error| error.to_string())
    };
    let sum =
        || WeightedSum::new(vec![(1.0, Box::new(GoalMse::default()) as _), (0.1, Box::new(Plain) as _)]);
    type Parts = (Box<dyn Objective>, Vec<Box<dyn Constraint>>);
    let parts: [Parts; 3] = [
        (Box::new(Plain), Vec::new()),
        (Box::new(sum().expect("finite weights")), Vec::new()),
        (Box::new(GoalMse::default()), vec![Box::new(Plain)]),
    ];
    for (objective, constraints) in parts {
        let is_constrained = !constraints.is_empty();
        let mut cost = ShootingCost::new(dynamics(), objective, constraints).expect("known parts");
        assert_eq!(refusal(&mut cost, &sampling), None);
        let refused = refusal(&mut cost, &gradients).expect("it has no gradient");
        assert!(refused.contains("adam needs a gradient"), "{refused}");
        assert_eq!(cost.constraints(10, 2) > 0, is_constrained, "values need no derivatives");
        assert!(refusal(&mut cost, &Lagrangian::default()).is_some());
    }
    let mut whole = ShootingCost::new(dynamics(), Box::new(GoalMse::default()), Vec::new()).unwrap();
    assert_eq!(refusal(&mut whole, &gradients), None);
}
