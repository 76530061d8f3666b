//! What every solve promises: plans that do not depend on their neighbors or on threads, and clear errors.

use std::collections::HashSet;

use serde_json::json;
use swm_core::{Dtype, Settings as _, Space};
use swm_solvers::{
    Candidates, Cem, Cost, NoTrace, Plan, PlanError, PlanningContext, SOLVERS, Solver, Validate, Workspace,
};

use crate::problems::{Analytic, LQ_OPTIMA, PlanCost, Trial, keys, lq, nav, problem, space};

const SIZE: usize = 20;

fn solve(solver: &dyn Solver, cost: &mut dyn Cost, episodes: &[u64]) -> Result<Plan, PlanError> {
    solve_trial(&Trial::lq(), solver, cost, episodes)
}

fn solve_trial(
    trial: &Trial,
    solver: &dyn Solver,
    cost: &mut dyn Cost,
    episodes: &[u64],
) -> Result<Plan, PlanError> {
    let keys = keys(episodes.iter().copied());
    let initial = vec![0.0; keys.len() * trial.size];
    let mut plan = Plan::new();
    let problem = trial.problem(&keys, &initial);
    solver.solve(&problem, cost, &mut Workspace::new(), &mut NoTrace, &mut plan)?;
    Ok(plan)
}

fn on_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be made").install(work)
}

#[test]
fn the_plan_of_an_episode_is_the_same_alone_and_among_64_on_1_and_2_threads() {
    // Those that need a model's states have tests of their own.
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        // Descent takes many evaluations per iteration here: fewer iterations show the same.
        let descends = entry.settings.iter().any(|setting| setting.name == "action_noise");
        let settings = if descends { json!({"iterations": 5}) } else { json!({}) };
        let solver = entry.make(settings.as_object().unwrap().clone()).unwrap();
        let trial = Trial::accepted_by(solver.as_ref());
        let plans = |cost: PlanCost, episodes: &[u64]| {
            solve_trial(&trial, solver.as_ref(), &mut Analytic::new(cost, 30), episodes).unwrap()
        };
        let all: Vec<u64> = (0..64).collect();
        let together = on_threads(2, || plans(trial.cost, &all));
        let one_thread = on_threads(1, || plans(trial.cost, &all));
        assert_eq!(together, one_thread, "{}", entry.name);
        for episode in [0, 4, 60] {
            // Row 0 is instance 0, as rows 4 and 60 are.
            let (alone, episode) = (plans(trial.cost, &[episode]), episode as usize);
            assert_eq!(alone.of(0), together.of(episode), "{}", entry.name);
            assert_eq!(alone.cost_of_returned[0], together.cost_of_returned[episode]);
            assert_eq!(alone.memory[0], together.memory[episode]);
        }
        // By four rows, so that every episode keeps its instance.
        let moved: Vec<u64> = (4..64).chain(0..4).collect();
        let moved = plans(trial.cost, &moved);
        assert!(
            (0..64).all(|episode| moved.of(episode) == together.of((episode + 4) % 64)),
            "{}",
            entry.name
        );
    }
}

#[test]
fn every_episode_has_noise_of_its_own() {
    let all: Vec<u64> = (0..64).collect();
    let plan = solve(&Cem::default(), &mut Analytic::new(nav, 30), &all).unwrap();
    let distinct: HashSet<Vec<u32>> =
        (0..16).map(|i| plan.of(4 * i).iter().map(|x| x.to_bits()).collect()).collect();
    assert_eq!(distinct.len(), 16, "all are of instance 0");
}

#[test]
fn later_plans_and_other_seeds_have_other_noise() {
    let (mut keys, space, initial) = (keys([5]), space(), [0.0; SIZE]);
    let mut plans = Vec::new();
    for (plan_index, seed) in [(0, 0), (1, 0), (0, 1)] {
        keys[0].plan = plan_index;
        let mut plan = Plan::new();
        let solver = Cem { seed, ..Cem::default() };
        let problem = problem(&keys, &space, &initial);
        solver
            .solve(&problem, &mut Analytic::new(lq, 30), &mut Workspace::new(), &mut NoTrace, &mut plan)
            .unwrap();
        plans.push(plan);
    }
    assert!(plans[0] != plans[1] && plans[0] != plans[2] && plans[1] != plans[2]);
}

#[test]
fn a_workspace_leaks_nothing_from_one_solve_into_the_next() {
    let (keys, space) = (keys(0..2), space());
    let initial = vec![0.0; 2 * SIZE];
    let (mut workspace, mut used) = (Workspace::new(), Plan::new());
    let solver = Cem { return_best: true, ..Cem::default() };
    let problem = problem(&keys, &space, &initial);
    solver.solve(&problem, &mut Analytic::new(nav, 30), &mut workspace, &mut NoTrace, &mut used).unwrap();
    solver.solve(&problem, &mut Analytic::new(lq, 30), &mut workspace, &mut NoTrace, &mut used).unwrap();
    assert_eq!(used, solve(&solver, &mut Analytic::new(lq, 30), &[0, 1]).unwrap());
}

#[test]
fn options_do_what_they_say() {
    let episodes = [0, 1, 2, 3];
    let plain = solve(&Cem::default(), &mut Analytic::new(lq, 30), &episodes).unwrap();
    let best = Cem { return_best: true, ..Cem::default() };
    let best = solve(&best, &mut Analytic::new(lq, 30), &episodes).unwrap();
    for (episode, optimum) in LQ_OPTIMA.iter().enumerate() {
        assert!(best.cost_of_returned[episode] <= plain.cost_of_returned[episode]);
        assert!(best.cost_of_returned[episode] <= plain.elite_mean_last[episode]);
        assert!(best.cost_of_returned[episode] >= optimum - 1e-4);
        assert_eq!(best.cost_of_returned[episode], f64::from(lq(episode, best.of(episode))));
    }

    assert!(plain.actions.iter().any(|value| value.abs() > 1.0), "the optimum lies outside of the bounds");
    let mut seen = Bounded { low: f32::INFINITY, high: f32::NEG_INFINITY };
    let clipped = solve(&Cem { clip: true, ..Cem::default() }, &mut seen, &episodes).unwrap();
    assert_eq!((seen.low, seen.high), (-1.0, 1.0));
    assert!(clipped.actions.iter().all(|value| value.abs() <= 1.0));

    let floor =
        solve(&Cem { sigma_min: 0.3, ..Cem::default() }, &mut Analytic::new(lq, 30), &episodes).unwrap();
    assert!(floor.std.iter().all(|&sigma| sigma >= 0.3));
    assert!(plain.std.iter().all(|&sigma| sigma < 0.3));

    let none =
        solve(&Cem { iterations: 0, ..Cem::default() }, &mut Analytic::new(lq, 30), &episodes).unwrap();
    assert_eq!(none.actions, vec![0.0; 4 * SIZE]);
    assert!(none.elite_mean_last.iter().all(|mean| mean.is_nan()));
    assert_eq!(none.cost_of_returned[1], f64::from(lq(1, none.of(1))));
}

/// Remembers the range of the candidates.
struct Bounded {
    low: f32,
    high: f32,
}

impl Cost for Bounded {
    fn prepare(&mut self, _context: &PlanningContext<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        for &value in candidates.actions {
            self.low = value.min(self.low);
            self.high = value.max(self.high);
        }
        costs.iter_mut().zip(candidates.plans()).for_each(|(cost, plan)| *cost = f64::from(lq(0, plan)));
        Ok(())
    }
}

/// Candidates whose first number is above `limit` have no usable cost.
struct Broken {
    limit: f32,
}

impl Cost for Broken {
    fn prepare(&mut self, _context: &PlanningContext<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        for (cost, plan) in costs.iter_mut().zip(candidates.plans()) {
            *cost = if plan[0] > self.limit { f64::NAN } else { f64::from(lq(0, plan)) };
        }
        Ok(())
    }
}

#[test]
fn costs_that_are_not_finite_are_worst_counted_and_never_elite() {
    let plan = solve(&Cem::default(), &mut Broken { limit: 0.5 }, &[0]).unwrap();
    assert!(plan.non_finite[0] > 0 && plan.cost_of_returned[0].is_finite());
    assert!(plan.of(0)[0] <= 0.5);
    // So few are usable in the first iteration that the elites would have to include unusable ones.
    let plan = solve(&Cem::default(), &mut Broken { limit: -1.8 }, &[0]).unwrap();
    assert!(plan.non_finite[0] > 270 && plan.elite_mean_last[0].is_finite());
    assert!(plan.actions.iter().all(|value| value.is_finite()));

    let error = solve(&Cem::default(), &mut Broken { limit: -100.0 }, &[17]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "episode 17, plan 0, iteration 0: all 300 candidates have a cost that is not finite; check the model, or \
         search in a smaller range (sigma, clip)"
    );
}

#[test]
fn lengths_that_cannot_be_intended_are_refused() {
    let (keys, space) = (keys(0..2), space());
    let refusal = |edit: &dyn Fn(&mut swm_solvers::Problem<'_>)| {
        let mut given = problem(&keys, &space, &[]);
        edit(&mut given);
        given.check().unwrap_err().to_string()
    };
    for length in [usize::MAX, 100_001] {
        let horizon = refusal(&|problem| problem.horizon = length);
        assert_eq!(horizon, format!("setting `horizon`: {length} is more than 100000"));
        let block = refusal(&|problem| problem.action_block = length);
        assert_eq!(block, format!("setting `action_block`: {length} is more than 100000"));
    }
    let both = refusal(&|problem| (problem.horizon, problem.action_block) = (100_000, 100_000));
    assert!(both.starts_with("setting `horizon`: 2 plans of 100000 blocks of 100000 actions"), "{both}");
    let wide = Space::MultiDiscrete { n: vec![i64::MAX; 3], start: vec![0; 3] };
    let many = swm_solvers::Problem { action: &wide, ..problem(&keys, &space, &[]) };
    assert!(many.check().unwrap_err().to_string().contains("too many"));
}

#[test]
fn wrong_problems_are_refused() {
    let (keys, space) = (keys(0..2), space());
    let message = |solver: &Cem, edit: &dyn Fn(&mut swm_solvers::Problem<'_>)| {
        let initial = vec![0.0; 2 * SIZE];
        let mut problem = problem(&keys, &space, &initial);
        let mut plan = Plan::new();
        edit(&mut problem);
        let solved = solver.solve(
            &problem,
            &mut Analytic::new(lq, 30),
            &mut Workspace::new(),
            &mut NoTrace,
            &mut plan,
        );
        solved.unwrap_err().to_string()
    };
    let cem = Cem::default();
    assert_eq!(message(&cem, &|p| p.horizon = 0), "setting `horizon`: 0 is too small; use 1 or more");
    assert_eq!(
        message(&cem, &|p| p.action_block = 0),
        "setting `action_block`: 0 is too small; use 1 or more"
    );
    assert_eq!(
        message(&cem, &|p| p.horizon = 9),
        "planning problem: `initial` must hold 36 values, found 40"
    );
    let crossed =
        Space::Box { dtype: Dtype::F32, shape: vec![2], low: vec![0.0, 1.0], high: vec![1.0, -1.0] };
    let problem = problem(&keys, &crossed, &[0.0; 2 * SIZE]);
    let error = cem
        .solve(&problem, &mut Analytic::new(lq, 30), &mut Workspace::new(), &mut NoTrace, &mut Plan::new())
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "cem cannot plan these actions: element 1 of the action has the bounds low 1 and high -1; low must not be above high"
    );
    let error = cem.check(&Space::Discrete { n: 5, start: 0 }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "cem cannot plan these actions: it needs real numbers (a box), and the action space is discrete; categorical-cem plans integers"
    );
    for (solver, part) in [
        (Cem { elites: 301, ..Cem::default() }, "setting `elites`: 301 of 300 samples"),
        (Cem { elites: 1, ..Cem::default() }, "setting `elites`: 1 is too few"),
        (Cem { samples: 10_000_000, ..cem.clone() }, "setting `samples`: 10000000 plans of 20 values"),
        (Cem { samples: 0, ..Cem::default() }, "setting `samples`: 0 is too small"),
        (Cem { sigma: f64::NAN, ..Cem::default() }, "setting `sigma`: NaN is not a positive number"),
        (Cem { sigma_min: -0.1, ..Cem::default() }, "setting `sigma_min`: -0.1 is not a number from 0 on"),
    ] {
        let message = message(&solver, &|_| {});
        assert!(message.starts_with(part), "{message}");
    }
}

#[test]
fn no_episodes_need_no_plans() {
    let plan = solve(&Cem { return_best: true, ..Cem::default() }, &mut Analytic::new(lq, 30), &[]).unwrap();
    assert!(plan.actions.is_empty() && plan.cost_of_returned.is_empty());
}

#[test]
fn settings_survive_json() {
    let solver = Cem { samples: 64, sigma: 0.5, seed: 3, ..Cem::default() };
    assert_eq!(serde_json::to_value(&solver).unwrap()["samples"], 64);
    assert_eq!(Cem::from_settings(solver.changed()).unwrap(), solver);
    assert_eq!(json!(solver.changed()), json!({"samples": 64, "sigma": 0.5, "seed": 3}));
}
