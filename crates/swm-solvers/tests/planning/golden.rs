//! Golden problems: our solvers against the distribution of the reference's results over 20 seeds.
//!
//! The generators differ, so means are compared: the difference must be within 3 standard errors (plus 1e-4 of the
//! mean). Seeds are fixed; a failure is first checked with other seeds.

use swm_solvers::{Cem, NoTrace, Plan, Solver, Workspace};

use crate::problems::{Analytic, LQ_OPTIMA, Trial, keys, lq, problem, space};

/// Seeds of the reference's runs.
const GOLDEN_SEEDS: f64 = 20.0;
/// Our seeds per instance.
const SEEDS: u64 = 100;

/// Mean and standard deviation of the reference's final costs, by instance.
pub(super) struct Golden {
    pub(super) mean: [f64; 4],
    pub(super) std: [f64; 4],
}

pub(super) struct Run {
    pub(super) plan: Plan,
    pub(super) cost: Analytic,
    size: usize,
}

/// Row `b` is instance `b % 4` with seed `b / 4`.
pub(super) fn run(solver: &dyn Solver, trial: &Trial, elites: usize) -> Run {
    let keys = keys((0..4 * SEEDS).map(|episode| episode / 4));
    let initial = vec![0.0; keys.len() * trial.size];
    let mut run = Run { plan: Plan::new(), cost: Analytic::new(trial.cost, elites), size: trial.size };
    let problem = trial.problem(&keys, &initial);
    solver
        .solve(&problem, &mut run.cost, &mut Workspace::new(), &mut NoTrace, &mut run.plan)
        .expect("finite costs");
    run
}

fn mean_and_std(values: impl Iterator<Item = f64> + Clone) -> (f64, f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, variance.sqrt(), count)
}

fn instance(values: &[f64], instance: usize) -> impl Iterator<Item = f64> + Clone {
    values.iter().copied().skip(instance).step_by(4)
}

fn assert_near(what: &str, golden: (f64, f64), values: impl Iterator<Item = f64> + Clone) {
    let (mean, std, count) = mean_and_std(values);
    let error = 3.0 * (golden.1.powi(2) / GOLDEN_SEEDS + std.powi(2) / count).sqrt() + 1e-4 * golden.0.abs();
    let difference = (mean - golden.0).abs();
    assert!(difference <= error, "{what}: mean {mean}, golden {}, allowed difference {error}", golden.0);
}

/// Final costs of several seeds of every instance.
pub(super) fn check_costs(name: &str, costs: &[f64], golden: &Golden) {
    for i in 0..4 {
        let what = format!("{name}, instance {i}");
        assert_near(&what, (golden.mean[i], golden.std[i]), instance(costs, i));
    }
}

pub(super) fn check(name: &str, run: &Run, golden: &Golden) {
    check_costs(name, &run.plan.cost_of_returned, golden);
    for (episode, plan) in run.plan.actions.chunks_exact(run.size).enumerate() {
        let cost = f64::from((run.cost.cost)(episode % 4, plan));
        assert_eq!(
            cost, run.plan.cost_of_returned[episode],
            "the reported cost is that of the returned plan"
        );
    }
}

/// Iteration number, from 1, and the golden means of the smallest, of the elite and of all its costs, by instance.
pub(super) type Columns = (usize, [f64; 4], [f64; 4], [f64; 4]);

/// Checks some iterations. The golden std is not known and taken as ours.
pub(super) fn check_iterations(name: &str, run: &Run, golden: &[Columns]) {
    check_iterations_of_std(name, run, golden, [0.0; 4]);
}

/// The same, where the golden std is known to be no less than `std`.
pub(super) fn check_iterations_of_std(name: &str, run: &Run, golden: &[Columns], std: [f64; 4]) {
    for &(number, min, elite, mean) in golden {
        let seen = &run.cost.iterations[number - 1];
        let columns: [(Vec<f64>, _); 3] = [
            (seen.iter().map(|s| s.min).collect(), min),
            (seen.iter().map(|s| s.elite).collect(), elite),
            (seen.iter().map(|s| s.mean).collect(), mean),
        ];
        for (column, golden) in columns {
            for (i, golden) in golden.into_iter().enumerate() {
                let (_, own, _) = mean_and_std(instance(&column, i));
                let what = format!("{name}, iteration {number}, instance {i}");
                assert_near(&what, (golden, own.max(std[i])), instance(&column, i));
            }
        }
    }
}

#[test]
fn cem_on_the_linear_quadratic_problem() {
    let run = run(&Cem::default(), &Trial::lq(), 30);
    let golden = Golden {
        mean: [4.63356, 3.98693, 6.7054, 19.8292],
        std: [0.0702603, 0.0639247, 0.0822742, 0.225737],
    };
    check("cem_lq", &run, &golden);
    let columns = [
        (
            1,
            [8.86144, 8.50562, 11.3051, 27.1151],
            [18.0968, 16.129, 19.5617, 41.8355],
            [103.067, 96.9811, 101.669, 144.212],
        ),
        (
            5,
            [5.40279, 4.56933, 7.48805, 21.876],
            [8.90094, 7.94887, 11.0411, 25.7839],
            [34.1859, 33.4049, 38.0429, 55.3846],
        ),
        (
            30,
            [4.63198, 3.9855, 6.70324, 19.8223],
            [4.64111, 3.99394, 6.71252, 19.8388],
            [4.6804, 4.0325, 6.75145, 19.8896],
        ),
    ];
    check_iterations("cem_lq", &run, &columns);
    for (episode, &cost) in run.plan.cost_of_returned.iter().enumerate() {
        assert!(cost >= LQ_OPTIMA[episode % 4] - 1e-4, "{cost} is below the optimum");
        assert_eq!(run.plan.elite_mean_last[episode], run.cost.iterations[29][episode].elite);
    }
}

#[test]
fn small_cem_on_the_linear_quadratic_problem() {
    let run = run(&Cem { samples: 64, iterations: 8, elites: 8, ..Cem::default() }, &Trial::lq(), 8);
    let golden =
        Golden { mean: [5.50856, 4.95083, 7.65328, 22.1361], std: [0.437752, 0.499027, 0.253264, 1.28485] };
    check("cem_small_lq", &run, &golden);
    let columns = [
        (
            2,
            [8.41093, 6.76639, 10.1677, 28.4344],
            [14.0106, 12.9171, 16.1485, 35.2338],
            [67.5789, 64.3147, 69.6262, 99.6477],
        ),
        (
            8,
            [5.56135, 4.94236, 7.67951, 22.2064],
            [6.06566, 5.48871, 8.23449, 22.8092],
            [10.557, 10.1838, 12.4065, 27.6548],
        ),
    ];
    check_iterations("cem_small_lq", &run, &columns);
}

#[test]
fn cem_on_the_navigation_problem() {
    let run = run(&Cem::default(), &Trial::nav(), 30);
    for golden in [
        Golden {
            mean: [9.72674, 3.97888, 7.7876, 5.26243],
            std: [0.167817, 0.00875256, 0.0181606, 0.00460973],
        },
        Golden {
            mean: [9.69622, 3.97821, 7.78178, 5.26279],
            std: [0.15467, 0.00547747, 0.0198161, 0.00566317],
        },
    ] {
        check("cem_nav", &run, &golden);
    }
    let columns = [
        (
            2,
            [17.779, 6.20023, 12.5188, 8.75804],
            [23.6693, 9.65809, 16.139, 13.2263],
            [33.682, 23.7376, 25.3085, 29.2412],
        ),
        (
            30,
            [9.69609, 3.97815, 7.78156, 5.26276],
            [9.6965, 3.97836, 7.78213, 5.26288],
            [9.69719, 3.97879, 7.78315, 5.26312],
        ),
    ];
    check_iterations("cem_nav", &run, &columns);
}

#[test]
fn sample_0_is_the_mean_of_the_last_refit() {
    let keys = keys([3]);
    let (space, initial) = (space(), vec![0.0; 20]);
    let problem = problem(&keys, &space, &initial);
    let mut cost = Analytic::new(lq, 30);
    let mut plan = Plan::new();
    Cem::default().solve(&problem, &mut cost, &mut Workspace::new(), &mut NoTrace, &mut plan).unwrap();
    for iterations in [0, 1, 7] {
        let mut shorter = Analytic::new(lq, 30);
        let solver = Cem { iterations, ..Cem::default() };
        solver.solve(&problem, &mut shorter, &mut Workspace::new(), &mut NoTrace, &mut plan).unwrap();
        assert_eq!(plan.cost_of_returned[0], cost.iterations[iterations][0].first);
    }
}
