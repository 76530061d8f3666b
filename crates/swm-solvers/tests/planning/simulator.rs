//! Planning on the true simulator: exact costs, goals reached, results that depend on nothing but the seed.

use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{EnvConfig, EnvEntry, Policy, PolicyContext, PolicyError, Registry};
use swm_solvers::testing::{Probe, ProbeResult};
use swm_solvers::{Aggregate, MpcPolicy, PLANNERS, PlanConfig, SimulatorCost, SimulatorOptions};

use crate::worlds::{FRAGILE, NO_TASK_COST, Setting, run, toward};

fn planner(entry: &EnvEntry, text: &str) -> Result<Box<dyn Policy>, PolicyError> {
    Registry::new().with(PLANNERS).policy(text, PolicyContext::new(entry, &EnvConfig::default()))
}

const SMALL: &str = "cem:samples=32,iterations=4,elites=6,horizon=3,receding_horizon=2,action_block=2";

#[test]
fn cem_reaches_the_goal_with_any_number_of_environments_and_threads() {
    let base = Setting { episodes: 12, max_steps: 40, ..Setting::default() };
    let stories = run(&base, planner(&TOY, SMALL).unwrap()).unwrap();
    assert!(stories.iter().all(|story| story.success == Some(true)));
    let steps: usize = stories.iter().map(|story| story.actions.len()).sum();
    let shortest: f64 =
        stories.iter().map(|story| (story.states[0] - story.states[story.states.len() - 1]).abs()).sum();
    assert!((steps as f64) < 1.5 * shortest + 12.0, "{steps} steps over a distance of {shortest}");
    for (num_envs, threads) in [(1, 2), (3, 1), (8, 2)] {
        let setting = Setting { num_envs, threads, ..base.clone() };
        assert_eq!(run(&setting, planner(&TOY, SMALL).unwrap()).unwrap(), stories, "{num_envs} {threads}");
    }
    let other = run(&base, planner(&TOY, &format!("{SMALL},seed=1")).unwrap()).unwrap();
    assert_ne!(other, stories, "the planner's own seed matters");
}

/// Costs of plans of 4 actions, from 0 with the goal at `goal`.
fn costs(
    entry: EnvEntry,
    goal: f64,
    options: SimulatorOptions,
    clip_actions: bool,
    plans: &[[f32; 4]],
) -> Vec<f64> {
    let plans: Vec<Vec<f32>> = plans.iter().map(|plan| plan.to_vec()).collect();
    probe(entry, goal, options, clip_actions, &plans).costs
}

/// What is result of plans of 4 actions, from 0 with the goal at `goal`.
fn probe(
    entry: EnvEntry,
    goal: f64,
    options: SimulatorOptions,
    clip_actions: bool,
    plans: &[Vec<f32>],
) -> ProbeResult {
    let (probe, result) = Probe::new(plans.concat(), plans.len());
    let simulator = SimulatorCost::new(&entry, &EnvConfig::default(), options).expect("valid options");
    let config = PlanConfig {
        horizon: 4,
        receding_horizon: 1,
        action_block: 1,
        clip_actions,
        ..PlanConfig::default()
    };
    let policy = MpcPolicy::new(Box::new(probe), Box::new(simulator), config).expect("a valid configuration");
    let setting = Setting { entry, max_steps: 1, threads: 2, reset: toward(goal), ..Setting::default() };
    run(&setting, policy).expect("a run without failures");
    let result = result.lock().expect("one thread").clone();
    assert_eq!(result.costs, result.costs_with_gradient);
    result
}

#[test]
fn the_cost_is_what_the_environment_says_after_the_plan() {
    let slow = [0.5; 4];
    let there_and_back = [1.0, 1.0, -1.0, -1.0];
    let plans = [slow, there_and_back];
    let of = |aggregate, plans: &[[f32; 4]]| {
        costs(TOY, 3.0, SimulatorOptions { aggregate, ..SimulatorOptions::default() }, true, plans)
    };
    assert_eq!(of(Aggregate::Last, &plans), [1.0, 3.0]);
    assert_eq!(of(Aggregate::Mean, &plans), [1.75, 2.0]);
    assert_eq!(of(Aggregate::Best, &plans), [1.0, 1.0]);
    // Success at step 3, whatever would follow; and clipped to 1, as it would be carried out.
    assert_eq!(of(Aggregate::Last, &[[1.0, 1.0, 1.0, -1.0], [9.0; 4]]), [-997.0, -997.0]);
}

#[test]
fn options_change_the_cost() {
    let plans = [[1.0, 1.0, 1.0, 0.2], [0.5; 4]];
    let bonus = |success_bonus| SimulatorOptions { success_bonus, ..SimulatorOptions::default() };
    assert_eq!(costs(TOY, 3.0, bonus(50.0), true, &plans), [-47.0, 1.0]);
    // The toy terminates on success, so the roll-out ends there even without a bonus.
    assert_eq!(costs(TOY, 3.0, bonus(0.0), true, &plans), [0.0, 1.0]);
    let skip = SimulatorOptions { frame_skip: 2, ..SimulatorOptions::default() };
    assert_eq!(costs(TOY, 10.0, skip, true, &[[0.5; 4]]), [6.0]);
    assert_eq!(costs(TOY, 10.0, bonus(0.0), false, &[[2.0; 4]]), [2.0], "unclipped, as the policy would act");
}

#[test]
fn roll_outs_go_on_past_success_if_asked_to() {
    // All but the first reach the goal with their third action; the last two leave it with the fourth.
    let plans = [[0.5; 4], [1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, -1.0], [1.0, 1.0, 1.0, 1.0]];
    let on = SimulatorOptions { stop_at_success: false, ..SimulatorOptions::default() };
    assert_eq!(costs(TOY, 3.0, on.clone(), true, &plans), [1.0, 0.0, 1.0, 1.0]);
    let mean = SimulatorOptions { aggregate: Aggregate::Mean, ..on.clone() };
    assert_eq!(costs(TOY, 3.0, mean, true, &plans[2..]), [1.0, 1.0]);
    // The action after the success has a slope, which it has not where the roll-out ends before it.
    let of = |options| probe(TOY, 3.0, options, true, &[vec![0.99, 0.99, 0.99, 0.5]]).gradient[3];
    assert!((of(on) - 1.0).abs() < 1e-3);
    assert_eq!(of(SimulatorOptions::default()), 0.0);
}

#[test]
fn a_roll_out_that_diverges_or_is_not_finite_costs_infinity() {
    let plans = [[0.5; 4], [0.5, 0.5, 0.9, 0.5], [f32::NAN; 4]];
    assert_eq!(
        costs(FRAGILE, 10.0, SimulatorOptions::default(), false, &plans),
        [8.0, f64::INFINITY, f64::INFINITY]
    );
    assert_eq!(costs(TOY, 10.0, SimulatorOptions::default(), true, &[[f32::NAN; 4]]), [f64::INFINITY]);
    let setting = Setting { entry: FRAGILE, reset: toward(5.0), max_steps: 30, ..Setting::default() };
    let stories = run(&setting, planner(&FRAGILE, SMALL).unwrap()).unwrap();
    assert_eq!(stories[0].success, Some(true), "planned around what breaks it");
}

#[test]
fn environments_that_cannot_be_planned_for_are_refused() {
    let message = |entry, text| planner(entry, text).err().expect("refused").to_string();
    assert_eq!(
        message(&DISCRETE_TOY, SMALL),
        "policy `cem`: cem cannot plan these actions: it needs real numbers (a box), and the action space is discrete; categorical-cem plans integers"
    );
    let setting = Setting { entry: NO_TASK_COST, ..Setting::default() };
    let error = run(&setting, planner(&NO_TASK_COST, SMALL).unwrap()).unwrap_err().to_string();
    assert!(error.contains("`swm/Toy-v0` has no task cost"), "{error}");
    let setting = Setting { entry: FRAGILE, ..Setting::default() };
    let error = run(&setting, planner(&TOY, SMALL).unwrap()).unwrap_err().to_string();
    assert!(error.contains("simulates `swm/Toy-v0` and cannot act in `swm/Fragile-v0`"), "{error}");
}

#[test]
fn gradients_are_those_of_the_simulation() {
    let of = |aggregate, plan: [f32; 4]| {
        let options = SimulatorOptions { aggregate, ..SimulatorOptions::default() };
        probe(TOY, 3.0, options, true, &[plan.to_vec(), vec![0.3; 4]]).gradient
    };
    let assert_near = |found: &[f32], expected: [f32; 4]| {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-3, "{found} is not {expected}");
        }
    };
    // The distance at the end shrinks by what any action grows.
    let gradient = of(Aggregate::Last, [0.5; 4]);
    assert_near(&gradient, [-1.0; 4]);
    assert_near(&gradient[4..], [-1.0; 4]);
    // Early actions shrink more of the distances.
    assert_near(&of(Aggregate::Mean, [0.5; 4]), [-1.0, -0.75, -0.5, -0.25]);
    assert_near(&of(Aggregate::Best, [0.5, 0.5, -0.5, -0.5]), [-1.0, -1.0, 0.0, 0.0]);
    // Beyond the goal the sign turns; the bonus of success is left out. After the end nothing counts.
    assert_near(&of(Aggregate::Last, [0.8, 0.8, 0.85, 0.98]), [1.0; 4]);
    assert_near(&of(Aggregate::Last, [0.9; 4]), [-1.0, -1.0, -1.0, 0.0]);
    // Beyond the bounds nothing changes.
    assert_near(&of(Aggregate::Last, [2.0, 0.1, -2.0, 0.1]), [0.0, -1.0, 0.0, -1.0]);
}

#[test]
fn integers_have_the_differences_to_other_categories() {
    // Left, stay, right; the goal is 3 to the right.
    let plan = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.5, 0.3]].concat();
    let seen = probe(DISCRETE_TOY, 3.0, SimulatorOptions::default(), true, &[plan]);
    assert_eq!(seen.costs, [3.0]);
    assert_eq!(seen.gradient, [0.0, -1.0, -2.0, 1.0, 0.0, -1.0, 2.0, 1.0, 0.0, 1.0, 0.0, -1.0]);
}

#[test]
fn solvers_with_gradients_reach_the_goal_with_any_number_of_environments_and_threads() {
    let shape = "horizon=3,receding_horizon=2,action_block=2";
    for (entry, text) in [
        (TOY, format!("adam:samples=4,iterations=8,lr=0.3,clip=true,{shape}")),
        (TOY, format!("sgd:samples=4,iterations=8,lr=0.2,clip=true,{shape}")),
        (TOY, format!("lagrangian:samples=4,iterations=8,rounds=1,lr=0.3,clip=true,{shape}")),
        (DISCRETE_TOY, format!("pgd:samples=4,iterations=8,{shape}")),
    ] {
        let base = Setting { entry, episodes: 6, max_steps: 40, ..Setting::default() };
        let stories = run(&base, planner(&entry, &text).unwrap()).unwrap();
        // Whole steps do not end at a goal between them.
        if entry.id == TOY.id {
            assert!(stories.iter().all(|story| story.success == Some(true)), "{text}");
        }
        let others = Setting { num_envs: 4, threads: 2, ..base };
        assert_eq!(run(&others, planner(&entry, &text).unwrap()).unwrap(), stories, "{text}");
    }
}
