//! What the options of the sampling solvers do, what the solvers refuse, and how near to known optima they come.

use serde_json::{Map, Value as Json, json};
use swm_core::{Dtype, Space};
use swm_solvers::{
    Candidates, CategoricalCem, Cost, Icem, Mppi, NoTrace, Outputs, Plan, PlanError, PredictiveSampling,
    Problem, SOLVERS, Solver, TemperatureMode, Workspace,
};

use crate::problems::{Analytic, DISC_OPTIMA, LQ_OPTIMA, Trial, keys, lq, problem, space};

fn solve(solver: &dyn Solver, problem: &Problem<'_>, cost: &mut dyn Cost) -> Result<Plan, PlanError> {
    let mut plan = Plan::new();
    solver.solve(problem, cost, &mut Workspace::new(), &mut NoTrace, &mut plan)?;
    Ok(plan)
}

/// Remembers all candidates of all iterations.
#[derive(Default)]
struct Seen {
    /// `[iteration][S × H × D]`.
    candidates: Vec<Vec<f32>>,
    samples: Vec<usize>,
    costs: Vec<Vec<f64>>,
}

impl Cost for Seen {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let costs = &mut *outputs.costs;
        costs.iter_mut().zip(candidates.plans()).for_each(|(cost, plan)| *cost = f64::from(lq(0, plan)));
        self.candidates.push(candidates.actions.to_vec());
        self.samples.push(candidates.samples);
        self.costs.push(costs.to_vec());
        Ok(())
    }
}

/// One episode, planned on the linear-quadratic problem.
fn watch(solver: &dyn Solver, initial: &[f32], memory: &[Vec<f64>]) -> (Plan, Seen) {
    let (keys, space, mut seen) = (keys([3]), space(), Seen::default());
    let problem = Problem { memory, ..problem(&keys, &space, initial) };
    (solve(solver, &problem, &mut seen).expect("finite costs"), seen)
}

/// Plan `sample` of one iteration.
fn candidate(candidates: &[f32], sample: usize) -> &[f32] {
    &candidates[sample * 20..][..20]
}

#[test]
fn a_cold_mppi_takes_the_best_sample_and_a_hot_one_the_mean_of_all() {
    let cold = Mppi { iterations: 1, temperature: 1e-9, ..Mppi::default() };
    let (plan, seen) = watch(&cold, &[0.0; 20], &[]);
    let best = (0..300).min_by(|&a, &b| seen.costs[0][a].total_cmp(&seen.costs[0][b])).unwrap();
    assert_eq!(plan.actions, candidate(&seen.candidates[0], best));

    let hot = Mppi { iterations: 1, elites: 0, temperature: 1e12, ..Mppi::default() };
    let (plan, seen) = watch(&hot, &[0.0; 20], &[]);
    for (d, value) in plan.actions.iter().enumerate() {
        let mean = (0..300).map(|s| f64::from(seen.candidates[0][s * 20 + d])).sum::<f64>() / 300.0;
        assert!((f64::from(*value) - mean).abs() < 1e-6);
    }
}

#[test]
fn a_relative_temperature_does_not_depend_on_the_unit_of_the_cost() {
    let thousand = |instance: usize, plan: &[f32]| 1024.0 * lq(instance, plan);
    for (mode, equal) in [(TemperatureMode::Relative, true), (TemperatureMode::Absolute, false)] {
        let solver = Mppi { temperature_mode: mode, ..Mppi::default() };
        let (keys, space) = (keys([0]), space());
        let problem = problem(&keys, &space, &[0.0; 20]);
        let plain = solve(&solver, &problem, &mut Analytic::new(lq, 30)).unwrap();
        let scaled = solve(&solver, &problem, &mut Analytic::new(thousand, 30)).unwrap();
        assert_eq!(plain.actions == scaled.actions, equal);
    }
}

#[test]
fn icem_tries_fewer_candidates_from_iteration_to_iteration() {
    let solver = Icem { decay: 1.25, iterations: 12, ..Icem::default() };
    let (_, seen) = watch(&solver, &[0.0; 20], &[]);
    assert_eq!(seen.samples, [300, 240, 192, 153, 122, 98, 78, 62, 60, 60, 60, 60, 1]);
    let solver = Icem { decay: 10.0, samples: 40, ..Icem::default() };
    let (_, seen) = watch(&solver, &[0.0; 20], &[]);
    assert_eq!(seen.samples[..3], [40, 40, 40], "never more than at first");
}

#[test]
fn icem_tries_the_mean_in_the_last_iteration_if_so_asked() {
    let solver = Icem { mean_at_last: true, iterations: 4, elites_kept: 0, ..Icem::default() };
    let (_, seen) = watch(&solver, &[0.25; 20], &[]);
    assert_ne!(candidate(&seen.candidates[0], 0), [0.25; 20]);
    let fewer = Icem { iterations: 3, ..solver };
    // Its third iteration has the mean where the other has noise: compare what both had learned before.
    let (_, shorter) = watch(&fewer, &[0.25; 20], &[]);
    assert_eq!(seen.candidates[1], shorter.candidates[1]);
    assert_ne!(candidate(&seen.candidates[2], 0), candidate(&shorter.candidates[2], 0));
    assert_eq!(candidate(&seen.candidates[2], 1), candidate(&shorter.candidates[2], 1));
    let (_, always) = watch(&Icem::default(), &[0.25; 20], &[]);
    assert_eq!(candidate(&always.candidates[0], 0), [0.25; 20]);
}

#[test]
fn icem_tries_elites_again_in_the_next_iteration_and_in_the_next_plan() {
    let solver = Icem { elite_shift: 3, iterations: 2, ..Icem::default() };
    let (plan, seen) = watch(&solver, &[0.0; 20], &[]);
    let order = |costs: &[f64]| {
        let mut order: Vec<usize> = (0..costs.len()).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        order
    };
    let elites = order(&seen.costs[0]);
    for (kept, &elite) in elites[..5].iter().enumerate() {
        let elite = candidate(&seen.candidates[0], elite);
        assert_eq!(candidate(&seen.candidates[1], kept + 1), elite);
    }
    let elites = order(&seen.costs[1]);
    let (_, next) = watch(&solver, &[0.0; 20], &plan.memory);
    let (_, fresh) = watch(&solver, &[0.0; 20], &[]);
    for (kept, &elite) in elites[..5].iter().enumerate() {
        let elite = candidate(&seen.candidates[1], elite);
        let reused = candidate(&next.candidates[0], kept + 1);
        assert_eq!(reused[..14], elite[6..], "without the three blocks that were carried out");
        assert_eq!(reused[14..], candidate(&fresh.candidates[0], kept + 1)[14..], "the rest is sampled");
    }
    assert_eq!(next.candidates[0][6 * 20..], fresh.candidates[0][6 * 20..]);
    let (plan, _) = watch(&Icem::default(), &[0.0; 20], &[]);
    assert!(plan.memory[0].is_empty(), "by default nothing is remembered");
}

#[test]
fn icem_samples_correlated_noise_within_bounds() {
    let (_, seen) = watch(&Icem::default(), &[0.0; 20], &[]);
    assert!(seen.candidates.iter().flatten().all(|value| value.abs() <= 1.0));
    // Neighbors in time, with the noise as it is: red noise is near itself.
    let correlation = |noise_beta: f64| {
        let solver = Icem { noise_beta, clip: false, iterations: 1, ..Icem::default() };
        let (_, seen) = watch(&solver, &[0.0; 20], &[]);
        let pairs = || {
            (20..300 * 20).filter(|i| i % 20 < 18).map(|i| (seen.candidates[0][i], seen.candidates[0][i + 2]))
        };
        let product: f32 = pairs().map(|(a, b)| a * b).sum();
        product / pairs().map(|(a, _)| a * a).sum::<f32>()
    };
    assert!(
        correlation(2.0) > 0.5 && correlation(0.0).abs() < 0.1,
        "{} {}",
        correlation(2.0),
        correlation(0.0)
    );
    let one_block = Trial { horizon: 1, size: 2, ..Trial::nav() };
    let keys = keys([0]);
    let plan = solve(
        &Icem::default(),
        &one_block.problem(&keys, &[0.0; 2]),
        &mut Analytic::new(|_, u| u[0] * u[0], 30),
    );
    assert!(plan.unwrap().cost_of_returned[0] < 1e-6, "a horizon of 1 is white noise");
}

/// Settings with which a solver comes within 1 % of the linear-quadratic optimum.
fn thorough(solver: &str) -> Map<String, Json> {
    let settings = match solver {
        // A floor under the std keeps the search from freezing before it has arrived.
        "cem" => json!({"iterations": 100, "sigma_min": 0.05}),
        "icem" => json!({
            "samples": 1000, "iterations": 60, "sigma_min": 0.05, "noise_beta": 0.5, "normalize": "analytic"
        }),
        "mppi" => json!({"iterations": 100, "sigma": 0.1, "temperature": 0.05}),
        "predictive-sampling" => json!({"iterations": 300, "sigma": 0.05}),
        "full-cem" => json!({"iterations": 60, "alpha": 0.5}),
        "sgd" => json!({"iterations": 150, "lr": 0.01, "momentum": 0.9}),
        "adam" | "adamw" => json!({"iterations": 300}),
        "pgd" => json!({"iterations": 500, "lr": 0.015}),
        "lagrangian" => json!({"iterations": 100}),
        _ => json!({}),
    };
    settings.as_object().expect("an object").clone()
}

#[test]
fn every_solver_of_real_actions_comes_near_the_linear_quadratic_optimum() {
    // So wide that no optimum lies outside of it.
    let (keys, wide) = (keys(0..4), Space::uniform_box(Dtype::F32, &[2], -5.0, 5.0));
    let problem = problem(&keys, &wide, &[0.0; 80]);
    // Those that need a model's states have tests of their own.
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        let solver = entry.make(thorough(entry.name)).expect("valid settings");
        if solver.check(&wide).is_err() {
            continue;
        }
        let plan = solve(solver.as_ref(), &problem, &mut Analytic::new(lq, 30)).expect("finite costs");
        let excess = plan.cost_of_returned.iter().zip(LQ_OPTIMA).map(|(cost, optimum)| cost / optimum - 1.0);
        let excess: Vec<f64> = excess.collect();
        println!("{}: {excess:?}", entry.name);
        assert!(excess.iter().all(|excess| (-1e-4..0.01).contains(excess)), "{}: {excess:?}", entry.name);
    }
}

#[test]
fn categorical_cem_finds_the_optimum_that_enumeration_finds() {
    let trial = Trial::disc();
    let keys = keys(0..100);
    let solver =
        CategoricalCem { smoothing: 0.05, alpha: 0.5, return_best: true, ..CategoricalCem::default() };
    let initial = vec![0.0; 100 * trial.size];
    let plan = solve(&solver, &trial.problem(&keys, &initial), &mut Analytic::new(trial.cost, 30)).unwrap();
    for (episode, cost) in plan.cost_of_returned.iter().enumerate() {
        assert!((cost - DISC_OPTIMA[episode % 4]).abs() < 1e-5, "episode {episode}: {cost}");
        assert!(plan.of(episode).chunks_exact(5).all(|group| group.iter().sum::<f32>() == 1.0));
        assert!(plan.of(episode).iter().all(|&value| value == 0.0 || value == 1.0));
    }
}

#[test]
fn categorical_cem_plans_several_integers_of_different_sizes() {
    let trial = Trial { space: Space::MultiDiscrete { n: vec![2, 3], start: vec![0, -1] }, ..Trial::disc() };
    let keys = keys([0]);
    let problem = Problem { action_block: 2, ..trial.problem(&keys, &[0.0; 60]) };
    // Wants the categories 1 and 2 everywhere, the second half of the plan more than the first.
    let wanted = |_: usize, plan: &[f32]| -> f32 {
        plan.chunks_exact(5).enumerate().map(|(i, a)| (1 + i) as f32 * (2.0 - a[1] - a[4])).sum()
    };
    let solver = CategoricalCem::default();
    let plan = solve(&solver, &problem, &mut Analytic::new(wanted, 30)).unwrap();
    assert_eq!(plan.actions, [0.0, 1.0, 0.0, 0.0, 1.0].repeat(12));
    assert_eq!(plan.cost_of_returned, [0.0]);

    let even = CategoricalCem { iterations: 0, ..solver };
    let plan = solve(&even, &problem, &mut Analytic::new(wanted, 30)).unwrap();
    let half = (0.5_f32 * 0.5).sqrt();
    let third = ((1.0 / 3.0_f32) * (2.0 / 3.0)).sqrt();
    for group in plan.std.chunks_exact(5) {
        assert!(group.iter().zip([half, half, third, third, third]).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}

#[test]
fn categorical_cem_starts_from_the_last_plan_if_so_asked() {
    let trial = Trial::disc();
    let keys = keys([0]);
    let mut initial = [0.0; 30];
    // The first 4 blocks are known.
    (0..4).for_each(|block| initial[block * 5 + 3] = 1.0);
    let first = |epsilon: f64| {
        let mut seen = Counts::default();
        let solver =
            CategoricalCem { warm_start_epsilon: epsilon, iterations: 1, ..CategoricalCem::default() };
        solve(&solver, &trial.problem(&keys, &initial), &mut seen).unwrap();
        seen.0
    };
    let (warm, cold) = (first(0.2), first(1.0));
    for block in 0..6 {
        let share = |counts: &[f32]| counts[block * 5 + 3] / 300.0;
        let expected = if block < 4 { 0.8 + 0.2 / 5.0 } else { 0.2 };
        assert!((share(&warm) - expected).abs() < 0.08, "block {block}: {}", share(&warm));
        assert!((share(&cold) - 0.2).abs() < 0.08, "block {block}: {}", share(&cold));
    }
}

/// How often every number was 1 in the first iteration.
#[derive(Default)]
struct Counts(Vec<f32>);

impl Cost for Counts {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        outputs.costs.fill(0.0);
        if self.0.is_empty() {
            self.0.resize(candidates.horizon * candidates.dim, 0.0);
            for plan in candidates.plans() {
                self.0.iter_mut().zip(plan).for_each(|(sum, value)| *sum += value);
            }
        }
        Ok(())
    }
}

#[test]
fn settings_out_of_range_are_named() {
    for (solver, settings, part) in [
        (
            "icem",
            json!({"elites_kept": 300, "elites": 300}),
            "`elites_kept`: 300 and the mean are more than 300",
        ),
        ("icem", json!({"elites": 301}), "`elites`: 301 of 300 samples"),
        ("icem", json!({"elites": 1}), "`elites`: 1 is too few"),
        ("icem", json!({"alpha": 1.0}), "`alpha`: 1 is not a number from 0 to 1 (excluded)"),
        ("icem", json!({"decay": 0.5}), "`decay`: 0.5 is not a number from 1 on"),
        ("icem", json!({"noise_beta": -1.0}), "`noise_beta`: -1 is not"),
        (
            "icem",
            json!({"normalize": "max"}),
            "`normalize`: no value `max`; there are `per_sequence`, `analytic`",
        ),
        ("mppi", json!({"temperature": 0.0}), "`temperature`: 0 is not a positive number"),
        ("mppi", json!({"elites": 301}), "`elites`: 301 of 300 samples"),
        ("mppi", json!({"samples": 100000000}), "`samples`: 100000000 is more than 10000000"),
        ("predictive-sampling", json!({"samples": 0}), "`samples`: 0 is too small"),
        ("predictive-sampling", json!({"sigma": -1.0}), "`sigma`: -1 is not a positive number"),
        ("categorical-cem", json!({"smoothing": -0.5}), "`smoothing`: -0.5 is not a number from 0 on"),
        ("categorical-cem", json!({"elites": 0}), "`elites`: 0 is too small"),
        ("categorical-cem", json!({"warm_start_epsilon": 1.5}), "`warm_start_epsilon`: 1.5 is not"),
    ] {
        let entry = SOLVERS.iter().find(|entry| entry.name == solver).unwrap();
        let settings = settings.as_object().unwrap().clone();
        let error = entry.make(settings).err().expect(part).to_string();
        assert!(error.starts_with(&format!("setting {part}")), "{solver}: {error}");
    }
}

#[test]
fn solvers_refuse_actions_of_the_wrong_kind() {
    let message = |solver: &dyn Solver, space: &Space| solver.check(space).unwrap_err().to_string();
    let five = Space::Discrete { n: 5, start: 0 };
    for solver in [&Icem::default() as &dyn Solver, &Mppi::default(), &PredictiveSampling::default()] {
        let name = solver.name();
        let reason =
            "it needs real numbers (a box), and the action space is discrete; categorical-cem plans integers";
        assert_eq!(message(solver, &five), format!("{name} cannot plan these actions: {reason}"));
    }
    let solver = CategoricalCem::default();
    assert_eq!(
        message(&solver, &space()),
        "categorical-cem cannot plan these actions: it needs integers, and the action space is box"
    );
    let none = Space::MultiDiscrete { n: vec![2, 0], start: vec![0, 0] };
    assert_eq!(
        message(&solver, &none),
        "categorical-cem cannot plan these actions: element 1 of the action has no categories"
    );
}
