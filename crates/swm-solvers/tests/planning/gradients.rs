//! Solvers that follow gradients, on the golden problems: plans of a single start are those of the reference to its
//! last digits, costs of several starts have its distribution.

use swm_core::Space;
use swm_solvers::models::{ControlCost, ControlModel, LinearQuadratic, Navigation};
use swm_solvers::{
    Adam, AdamW, Candidates, Cost, Descent, IterationRecord, Memory, NoTrace, Outputs, Pgd, Plan, PlanError,
    Problem, Select, Sgd, Solver, Trace, Workspace,
};

use crate::golden::{Golden, check_costs};
use crate::problems::{DISC_OPTIMA, LQ_OPTIMA, disc, disc_gradient, keys, problem, space};

/// Row `b` is instance `b % 4` with seed `b / 4`; plans start at zero.
pub(super) fn solve(
    solver: &dyn Solver,
    cost: &mut dyn Cost,
    shape: (&Space, usize, usize),
    seeds: u64,
) -> Result<Plan, PlanError> {
    traced(solver, cost, shape, seeds, &mut NoTrace)
}

fn traced(
    solver: &dyn Solver,
    cost: &mut dyn Cost,
    shape: (&Space, usize, usize),
    seeds: u64,
    trace: &mut dyn Trace,
) -> Result<Plan, PlanError> {
    let (space, horizon, dim) = shape;
    let keys = keys((0..4 * seeds).map(|episode| episode / 4));
    let initial = vec![0.0; keys.len() * horizon * dim];
    let mut plan = Plan::new();
    let problem = Problem { horizon, ..problem(&keys, space, &initial) };
    solver.solve(&problem, cost, &mut Workspace::new(), trace, &mut plan)?;
    Ok(plan)
}

fn on(model: impl ControlModel, solver: &dyn Solver, seeds: u64) -> Plan {
    solve(solver, &mut ControlCost::new(model), (&space(), 10, 2), seeds).expect("finite costs")
}

fn on_lq(solver: &dyn Solver, seeds: u64) -> Plan {
    on(LinearQuadratic::point_mass(), solver, seeds)
}

fn on_nav(solver: &dyn Solver, seeds: u64) -> Plan {
    on(Navigation::past_one_obstacle(), solver, seeds)
}

fn on_disc(solver: &dyn Solver, seeds: u64) -> Plan {
    let space = Space::Discrete { n: 5, start: 0 };
    solve(solver, &mut SingleDisc, (&space, 6, 5), seeds).expect("finite costs")
}

/// The golden discrete problem in single precision: the goal of instance 3 lies on a diagonal, so that left and down are
/// equally good, and only the rounding of the reference says which it takes.
struct SingleDisc;

impl Cost for SingleDisc {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        for (index, (plan, cost)) in candidates.plans().zip(costs.iter_mut()).enumerate() {
            let instance = index / candidates.samples % 4;
            *cost = disc(instance, plan).into();
            if let Some(gradient) = gradient {
                disc_gradient(instance, plan, &mut gradient[30 * index..][..30]);
            }
        }
        Ok(())
    }
    fn has_gradients(&self) -> bool {
        true
    }
}

fn descent(samples: usize, iterations: usize) -> Descent {
    Descent { samples, iterations, ..Descent::default() }
}

fn sgd(samples: usize, lr: f64, momentum: f64) -> Sgd {
    Sgd { descent: descent(samples, 50), lr, momentum, ..Sgd::default() }
}

fn adam(samples: usize) -> Adam {
    Adam { descent: descent(samples, 50), ..Adam::default() }
}

fn adamw(samples: usize) -> AdamW {
    AdamW { descent: descent(samples, 50), ..AdamW::default() }
}

fn assert_plan(name: &str, plan: &[f32], golden: [f64; 20]) {
    for (index, (&found, expected)) in plan.iter().zip(golden).enumerate() {
        let error = (f64::from(found) - expected).abs();
        assert!(error <= 1e-4, "{name}, number {index}: {found} is not {expected}");
    }
}

fn assert_costs(name: &str, plan: &Plan, golden: [f64; 4]) {
    for (episode, (&found, expected)) in plan.cost_of_returned.iter().zip(golden).enumerate() {
        assert!((found - expected).abs() <= 1e-4 * expected, "{name}, {episode}: {found} is not {expected}");
    }
}

#[test]
#[rustfmt::skip]
fn plans_of_one_start_are_the_references() {
    let plan = on_lq(&sgd(1, 0.02, 0.0), 1);
    assert_costs("sgd, lq", &plan, [4.65255, 4.01963, 6.73009, 20.0355]);
    assert_plan("sgd, lq", plan.of(0), [
        -1.150212, 0.0, -0.523929, 0.0, -0.136675, 0.0, 0.080878, 0.0, 0.184831, 0.0,
        0.219331, 0.0, 0.218462, 0.0, 0.208381, 0.0, 0.209400, 0.0, 0.237847, 0.0,
    ]);
    assert_plan("sgd, lq", plan.of(3), [
        -1.164704, -1.725318, -0.456245, -0.785893, -0.032682, -0.205013, 0.192923, 0.121317, 0.289377, 0.277246,
        0.309744, 0.328996, 0.294221, 0.327694, 0.273096, 0.312571, 0.269503, 0.314099, 0.301779, 0.356770,
    ]);
    assert_costs("momentum, lq", &on_lq(&sgd(1, 0.01, 0.9), 1), [4.46665, 3.86957, 6.49733, 19.3297]);

    let plan = on_lq(&adam(1), 1);
    assert_costs("adam, lq", &plan, [4.74767, 3.97852, 6.71198, 20.5938]);
    assert_plan("adam, lq", plan.of(0), [
        -1.027975, 0.0, -0.573166, 0.0, -0.218966, 0.0, 0.030784, 0.0, 0.182910, 0.0,
        0.249046, 0.0, 0.243859, 0.0, 0.188815, 0.0, 0.127217, 0.0, 0.168284, 0.0,
    ]);
    assert_plan("adam, lq", plan.of(3), [
        -1.279369, -1.247700, -0.566602, -0.780367, -0.047585, -0.385498, 0.271136, -0.078470, 0.418905, 0.137142,
        0.434181, 0.265613, 0.357792, 0.317738, 0.238892, 0.316237, 0.143248, 0.316874, 0.262024, 0.468586,
    ]);

    let plan = on_lq(&adamw(1), 1);
    assert_costs("adamw, lq", &plan, [4.75371, 3.98244, 6.71767, 20.6265]);
    assert_plan("adamw, lq", plan.of(0), [
        -1.017184, 0.0, -0.570030, 0.0, -0.220918, 0.0, 0.025939, 0.0, 0.177096, 0.0,
        0.244016, 0.0, 0.241229, 0.0, 0.189905, 0.0, 0.132342, 0.0, 0.174388, 0.0,
    ]);
    assert_plan("adamw, lq", plan.of(3), [
        -1.263370, -1.234514, -0.563267, -0.775587, -0.051881, -0.386655, 0.263101, -0.083339, 0.410234, 0.130542,
        0.427428, 0.259106, 0.354930, 0.313016, 0.240928, 0.314594, 0.149668, 0.318108, 0.264930, 0.467455,
    ]);

    assert_costs("sgd, nav", &on_nav(&sgd(1, 0.02, 0.0), 1), [12.567, 4.79249, 9.29177, 6.16011]);
    let plan = on_nav(&sgd(1, 0.01, 0.9), 1);
    assert_costs("momentum, nav", &plan, [10.2396, 4.11138, 7.96244, 5.72149]);
    assert_plan("momentum, nav", plan.of(0), [
        0.341081, 2.236906, -0.367075, 2.146663, 0.325025, 2.109349, 1.282402, 1.922985, 1.891439, 1.408235,
        2.035165, 0.520014, 1.941151, -0.340369, 1.794042, -0.520994, 1.702164, -0.133158, 1.819440, 0.498209,
    ]);
    assert_plan("momentum, nav", plan.of(3), [
        -3.975965, -2.651312, -3.447951, -2.441228, -2.997677, -2.169175, -2.560612, -1.851803, -2.089909, -1.475759,
        -1.538066, -1.028106, -0.853354, -0.519353, -0.075956, -0.023235, 0.560697, 0.335526, 0.870768, 0.488243,
    ]);

    let plan = on_nav(&adam(1), 1);
    assert_costs("adam, nav", &plan, [10.2451, 4.24266, 11.3294, 5.72847]);
    assert_plan("adam, nav", plan.of(0), [
        0.206152, 1.965884, -0.046407, 1.912639, 0.237003, 1.889671, 0.809156, 1.778215, 1.216539, 1.439613,
        1.370054, 0.778046, 1.418829, -0.038199, 1.482726, -0.490863, 1.655343, -0.361787, 2.031487, 0.149538,
    ]);
    assert_plan("adam, nav", plan.of(3), [
        -1.617363, -1.837713, -1.401441, -1.669451, -1.258136, -1.471696, -1.129702, -1.256143, -0.992789, -1.010558,
        -0.839974, -0.734881, -0.667325, -0.444633, -0.473628, -0.173718, -0.263036, 0.034251, -0.051542, 0.139594,
    ]);
}

#[test]
fn several_starts_have_the_references_distribution() {
    let golden = |mean, std| Golden { mean, std };
    let single = on_lq(&sgd(1, 0.02, 0.0), 1);
    let plan = on_lq(&sgd(8, 0.02, 0.0), 100);
    let tiny = 9.78449e-07;
    check_costs(
        "sgd, lq, 8",
        &plan.cost_of_returned,
        &golden([4.65255, 4.01963, 6.73009, 20.0183], [tiny, 0.0, 0.0, 0.0640516]),
    );
    for (episode, cost) in plan.cost_of_returned.iter().enumerate() {
        assert!(*cost <= single.cost_of_returned[episode % 4] + 1e-4, "the first start is among the others");
        assert!(*cost >= LQ_OPTIMA[episode % 4] - 1e-4);
    }
    check_costs(
        "momentum, lq, 8",
        &on_lq(&sgd(8, 0.01, 0.9), 100).cost_of_returned,
        &golden([4.46665, 3.86957, 6.49733, 19.3289], [tiny, 0.0, 4.89225e-07, 0.00368109]),
    );
    check_costs(
        "adamw, lq, 8",
        &on_lq(&adamw(8), 100).cost_of_returned,
        &golden([4.74991, 3.98194, 6.70449, 20.3186], [0.0169559, 0.00180501, 0.0303257, 0.350023]),
    );
    let noisy = Adam { descent: Descent { action_noise: 0.05, ..descent(8, 50) }, ..Adam::default() };
    check_costs(
        "adam with noise, lq",
        &on_lq(&noisy, 100).cost_of_returned,
        &golden([5.73077, 4.86275, 7.56645, 21.2358], [0.535942, 0.504024, 0.393466, 0.695658]),
    );
    check_costs(
        "adam, nav, 8",
        &on_nav(&adam(8), 100).cost_of_returned,
        &golden([10.0509, 4.21713, 8.35838, 5.61565], [0.141514, 0.0507616, 0.296496, 0.0963953]),
    );
}

/// Of iteration `number`, counted from 1: the cheapest cost and the mean cost of the candidates, by instance.
fn check_iteration(name: &str, trace: &Memory, number: usize, golden: [[f64; 4]; 2], tolerance: f64) {
    for instance in 0..4 {
        let records =
            trace.plans().iter().skip(instance).step_by(4).map(|plan| &plan.iterations[number - 1].record);
        let mean = |of: fn(&IterationRecord) -> Option<f64>| {
            records.clone().map(|record| of(record).expect("costs are finite")).sum::<f64>()
                / records.len() as f64
        };
        for (found, golden) in
            [mean(|record| record.best), mean(|record| record.sample_mean)].into_iter().zip(golden)
        {
            let error = (found - golden[instance]).abs() / golden[instance];
            assert!(
                error <= tolerance,
                "{name}, iteration {number}, instance {instance}: {found} is not {golden:?}"
            );
        }
    }
}

#[test]
fn costs_of_iterations_are_the_references() {
    let mut trace = Memory::new(1);
    let mut lq = ControlCost::new(LinearQuadratic::point_mass());
    traced(&adam(1), &mut lq, (&space(), 10, 2), 1, &mut trace).expect("finite costs");
    for (number, costs) in [
        (1, [20.0, 13.9678, 18.6237, 63.6492]),
        (2, [11.6137, 8.36328, 12.7639, 45.131]),
        (5, [10.7853, 7.67539, 11.5976, 33.8993]),
        (50, [4.77338, 3.98213, 6.72892, 20.604]),
    ] {
        check_iteration("adam, lq", &trace, number, [costs; 2], 1e-5);
    }
    let mut trace = Memory::new(1);
    let mut nav = ControlCost::new(Navigation::past_one_obstacle());
    traced(&sgd(1, 0.01, 0.9), &mut nav, (&space(), 10, 2), 1, &mut trace).expect("finite costs");
    for (number, costs) in [
        (2, [33.4473, 31.7359, 34.3882, 38.5735]),
        (5, [34.5739, 13.1807, 18.1304, 13.679]),
        (50, [10.2824, 4.13134, 7.98386, 5.72916]),
    ] {
        check_iteration("momentum, nav", &trace, number, [costs; 2], 1e-4);
    }
    // Sixteen random starts: means over 100 seeds, beside those of 20.
    let mut trace = Memory::new(1);
    let pgd = Pgd { descent: descent(16, 30), ..Pgd::default() };
    let shape = (&Space::Discrete { n: 5, start: 0 }, 6, 5);
    traced(&pgd, &mut SingleDisc, shape, 100, &mut trace).expect("finite costs");
    for (number, best, mean, tolerance) in [
        (1, [0.994038, 1.06179, 1.17182, 1.59438], [5.78965, 5.59408, 6.58622, 6.62961], 0.25),
        (2, [0.828974, 0.685525, 0.737506, 1.15738], [1.57724, 1.3845, 1.57376, 1.93026], 0.1),
        (5, [0.828045, 0.685389, 0.72057, 1.15738], [0.855049, 0.717871, 0.756807, 1.17636], 0.04),
        (30, [0.826844, 0.685016, 0.71535, 1.15738], [0.829016, 0.687233, 0.717643, 1.1596], 0.005),
    ] {
        check_iteration("pgd, disc", &trace, number, [best, mean], tolerance);
    }
}

#[test]
fn categories_are_planned_as_the_reference_does_and_better() {
    let pgd = |samples, select| Pgd { descent: descent(samples, 30), select, ..Pgd::default() };
    let golden = [[1, 1, 1, 1, 1, 3], [4, 4, 4, 4, 4, 1], [1, 1, 1, 1, 1, 1], [2, 4, 4, 4, 2, 2]];
    for select in [Select::Relaxed, Select::Rounded] {
        let plan = on_disc(&pgd(1, select), 1);
        assert_costs("pgd", &plan, [1.28525, 1.26725, 0.91975, 1.17925]);
        for (episode, golden) in golden.iter().enumerate() {
            let chosen: Vec<usize> = plan.of(episode).chunks(5).map(one).collect();
            assert_eq!(chosen, golden, "instance {episode}");
        }
    }
    let relaxed = on_disc(&pgd(16, Select::Relaxed), 100);
    check_costs(
        "pgd, 16",
        &relaxed.cost_of_returned,
        &Golden { mean: [1.11775, 1.26725, 0.742625, 1.17925], std: [0.196917, 0.0, 0.0484176, 1.22306e-07] },
    );
    let rounded = on_disc(&pgd(16, Select::Rounded), 100);
    for (episode, (&better, &cost)) in
        rounded.cost_of_returned.iter().zip(&relaxed.cost_of_returned).enumerate()
    {
        assert!(better <= cost && better >= DISC_OPTIMA[episode % 4] - 1e-6);
        assert!(
            (f64::from(disc(episode % 4, rounded.of(episode))) - better).abs() < 1e-6,
            "its own cost is reported"
        );
        assert!(rounded.elite_mean_last[episode] <= better, "mixtures are cheaper than plans");
    }
}

#[test]
fn with_many_starts_the_best_plan_by_categories_is_found() {
    let solver = Pgd { descent: descent(500, 10), ..Pgd::default() };
    let plan = on_disc(&solver, 25);
    for (episode, cost) in plan.cost_of_returned.iter().enumerate() {
        assert!((cost - DISC_OPTIMA[episode % 4]).abs() < 1e-5, "episode {episode}: {cost}");
    }
}

/// The index of the 1.
fn one(group: &[f32]) -> usize {
    assert!(group.iter().all(|&value| value == 0.0 || value == 1.0) && group.iter().sum::<f32>() == 1.0);
    group.iter().position(|&value| value == 1.0).expect("a sum of 1")
}
