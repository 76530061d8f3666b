//! The units that plans are made in, what a model is told of the past in them, and what the policy says of its plans.

use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{
    BoxError, Cancel, EnvConfig, EpisodeEnd, LiveStep, Recorder, Registry, Rollout, World, WorldError,
    WorldOptions,
};
use swm_solvers::{
    ActionScale, Cem, MpcPolicy, PLANNERS, PlanConfig, PlanError, SimulatorCost, SimulatorOptions,
};

use crate::mpc::{Outcome, act_in_units, config, far_goal, stair};
use crate::worlds::{Setting, run, toward};

#[test]
fn plans_are_normalized_actions_are_not_and_the_past_is() {
    let units = ActionScale::MeanStd { mean: vec![0.25], std: vec![0.5] };
    let config = PlanConfig { history_len: 3, ..config(2, 1, 2) };
    // Plan values 0.5, 1.5, 2.5, …; the bound 1 of the action is 1.5 in them.
    let Outcome { past, stories, .. } = act_in_units(config, &far_goal(), 50.0, Some(units));
    let planned = |step: usize| 50.0 * stair(step as u64 / 2, 0);
    for (step, &action) in stories[0].actions.iter().enumerate() {
        assert_eq!(action, (planned(step) * 0.5 + 0.25).min(1.0), "step {step}");
    }
    assert!(stories[0].actions.contains(&1.0) && stories[0].actions[0] == 0.5);
    for (plan, (_, values)) in past.iter().enumerate() {
        let now = 2 * plan;
        let executed: Vec<f32> = (now.saturating_sub(4)..now).map(|step| planned(step).min(1.5)).collect();
        assert_eq!(*values, executed, "at step {now}");
    }
}

#[test]
fn wrong_units_are_told_before_anything_moves() {
    let cost = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default()).unwrap();
    let two = ActionScale::MeanStd { mean: vec![0.0; 2], std: vec![1.0; 2] };
    let policy = MpcPolicy::new(Box::new(Cem::default()), Box::new(cost), config(2, 1, 2)).unwrap();
    let message = run(&far_goal(), policy.with_scale(two)).unwrap_err().to_string();
    assert!(message.contains("action_scale") && message.contains("the action has 1"), "{message}");
}

#[test]
fn integers_of_the_past_are_one_hot() {
    // A stair has the same number for all categories, so that the first is chosen: -1.
    let setting = Setting { entry: DISCRETE_TOY, reset: toward(1000.0), ..Setting::default() };
    let config = PlanConfig { history_len: 2, ..config(2, 1, 2) };
    let Outcome { past, stories, .. } = act_in_units(config, &setting, 1.0, None);
    assert_eq!(stories[0].actions, [-1.0; 12]);
    assert_eq!(past[0].1, [0.0; 0]);
    assert_eq!(past[3].1, [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
}

/// The columns about plans, and the action, of a row.
struct SaidRow {
    /// Cost, elite cost, std.
    figures: [f64; 3],
    /// Iterations, costs that are not finite.
    counts: [i64; 2],
    wall_time: Option<f64>,
    action: f32,
}

/// Every row with an action.
#[derive(Default)]
struct Said(Vec<SaidRow>);

impl Recorder for Said {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let real = |name| Ok::<f64, BoxError>(row.values.get::<f64>(name)?[0]);
        let count = |name| Ok::<i64, BoxError>(row.values.get::<i64>(name)?[0]);
        let action = row.values.get::<f32>("action")?[0];
        if !action.is_nan() {
            self.0.push(SaidRow {
                figures: [real("plan.cost")?, real("plan.elite_cost")?, real("plan.std")?],
                counts: [count("plan.iterations")?, count("plan.non_finite")?],
                wall_time: real("plan.wall_time_s").ok(),
                action,
            });
        }
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

fn said(policy: &str) -> Result<Vec<SaidRow>, Box<dyn std::error::Error>> {
    let options = WorldOptions::default().max_episode_steps(8);
    let registry = Registry::new().with(PLANNERS);
    let mut world = World::new(&TOY, options)?;
    world.set_policy(registry.policy(policy, &world)?)?;
    let mut said = Said::default();
    world.run(&Rollout::new(0..1).seed(1).options(toward(1000.0)), &mut said)?;
    Ok(said.0)
}

#[test]
fn columns_about_plans_stand_where_plans_were_made() {
    let policy = "cem:samples=16,elites=4,iterations=3,horizon=3,receding_horizon=2,action_block=2,report=";
    let timed = said(&format!("{policy}timed")).unwrap();
    for (step, row) in timed.iter().enumerate() {
        let ([cost, elite, std], time) = (row.figures, row.wall_time.unwrap());
        if step % 4 == 0 {
            assert!((900.0..1000.0).contains(&cost) && elite.is_finite() && std > 0.0, "step {step}");
            assert_eq!(row.counts, [3, 0]);
            assert!(time > 0.0);
        } else {
            assert!([cost, elite, std, time].iter().all(|value| value.is_nan()), "step {step}");
            assert_eq!(row.counts, [-1, -1]);
        }
    }
    let plain = said(&format!("{policy}plan")).unwrap();
    assert!(plain.iter().all(|row| row.wall_time.is_none()), "times only on request");
    let bits = |rows: &[SaidRow]| -> Vec<_> {
        rows.iter().map(|row| (row.figures.map(f64::to_bits), row.counts, row.action)).collect()
    };
    assert_eq!(bits(&plain), bits(&timed), "what is said changes nothing");
    let error = said(&format!("{policy}off")).err().unwrap().to_string();
    assert!(error.contains("plan.cost"), "{error}");
}

#[test]
fn planning_stops_within_a_plan_when_the_run_is_cancelled() {
    let cancel = Cancel::new();
    let mut world = World::new(&TOY, WorldOptions::new(2).threads(1)).unwrap();
    // A plan that would take hours.
    let policy =
        Registry::new().with(PLANNERS).policy("cem:iterations=100000,samples=10000", &world).unwrap();
    world.set_policy(policy).unwrap();
    let rollout = Rollout::new(0..2).options(toward(1000.0)).cancel(&cancel);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            cancel.cancel();
        });
        assert!(matches!(world.run(&rollout, &mut ()), Err(WorldError::Cancelled)));
    });
}

#[test]
fn the_error_of_a_cost_stays_whole() {
    let error = PlanError::Cost("no such model".into());
    assert_eq!(error.foreign().map(ToString::to_string).as_deref(), Some("no such model"));
    assert!(PlanError::Cancelled.foreign().is_none());
}
