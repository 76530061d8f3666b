//! Planning without a world: the same actions as the policy's in a world, what is kept from call to call, and what is refused.

#[path = "../../examples/plan_at_50_hz/model.rs"]
mod model;

use std::time::Duration;

use model::{Body, GOAL, OBSTACLE, RADIUS};
use serde_json::Map;
use swm_core::testing::TOY;
use swm_core::{Batch, Dtype, EnvConfig, Field, Schema, Space};
use swm_solvers::models::{ControlCost, ControlPenalty, DiscreteChain, Navigation, ShootingCost, Stepwise};
use swm_solvers::{
    Candidates, Cem, Cost, Memory, Mpc, MpcPolicy, Outputs, PlanConfig, PlanError, PlanningContext, SOLVERS,
    SimulatorCost, SimulatorOptions,
};

use crate::worlds::{Setting, Story, run};

/// A point on a line should end at its goal, along the way that its past suggests: reads rows, the past and past actions.
#[derive(Default)]
struct Homing {
    state: f64,
    goal: f64,
    drift: f64,
    plans: usize,
}

impl Cost for Homing {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let row = context.env(0).row;
        self.plans += 1;
        (self.state, self.goal) = (row.get::<f64>("state")?[0], row.get::<f64>("goal_state")?[0]);
        let Some(past) = context.history(0) else { return Ok(()) };
        let frames = (0..past.frames()).filter_map(|frame| past.frame(0, frame).as_f64(0));
        let actions = (0..past.frames() - 1).map(|index| f64::from(past.action(index)[0]));
        self.drift = frames.sum::<f64>().sin() + actions.sum::<f64>();
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        for (plan, cost) in candidates.plans().zip(outputs.costs.iter_mut()) {
            let end = self.state + plan.iter().map(|&push| f64::from(push)).sum::<f64>();
            *cost = (end - self.goal).powi(2) + 0.1 * (f64::from(plan[0]) - self.drift).powi(2);
        }
        Ok(())
    }

    fn history_fields(&self) -> Vec<String> {
        vec!["state".to_owned()]
    }
}

fn cem() -> Cem {
    Cem { samples: 32, iterations: 4, elites: 6, ..Cem::default() }
}

fn config() -> PlanConfig {
    PlanConfig { horizon: 5, receding_horizon: 2, history_len: 3, action_block: 1, ..PlanConfig::default() }
}

/// One row of the toy's columns that [`Homing`] reads.
fn row(state: f64, goal: f64) -> Batch {
    let fields = [Field::step("state", Dtype::F64, &[1]), Field::episode("goal_state", Dtype::F64, &[1])];
    let mut row = Batch::new(Schema::new(fields.to_vec()).expect("two names"), 1);
    row.get_mut::<f64>("state").expect("it is there")[0] = state;
    row.get_mut::<f64>("goal_state").expect("it is there")[0] = goal;
    row
}

fn line() -> Space {
    Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0)
}

#[test]
fn actions_are_those_of_the_policy_in_a_world() {
    let goal = 8.0;
    let reset = crate::worlds::toward(goal);
    let setting = Setting { episodes: 3, max_steps: 9, reset, ..Setting::default() };
    for config in [config(), PlanConfig { warm_start: false, ..config() }] {
        let policy = MpcPolicy::new(Box::new(cem()), Box::new(Homing::default()), config.clone()).unwrap();
        let stories = run(&setting, policy).unwrap();
        let mut mpc = Mpc::new(Box::new(cem()), config, line()).unwrap().with_seed(7);
        let mut cost = Homing::default();
        for (index, Story { states, actions, .. }) in stories.iter().enumerate() {
            assert!(actions.len() > 5, "the goal is several plans away");
            if index > 0 {
                mpc.reset();
            }
            for (step, (&state, &action)) in states.iter().zip(actions).enumerate() {
                let found = mpc.next(&mut cost, &row(state, goal)).unwrap();
                assert_eq!(found, [action], "episode {index}, step {step}");
            }
        }
        assert!(stories[0].actions != stories[1].actions, "noise differs between episodes");
    }
}

#[test]
fn it_plans_when_the_last_plan_is_used_up() {
    let config = PlanConfig { action_block: 3, ..config() };
    let mut mpc = Mpc::new(Box::new(cem()), config, line()).unwrap();
    let mut cost = Homing::default();
    assert!(mpc.last_plan().is_none());
    for step in 0..13 {
        mpc.next(&mut cost, &row(0.0, 100.0)).unwrap();
        assert_eq!(cost.plans, 1 + step / 6, "2 blocks of 3 actions are taken");
    }
    mpc.reset();
    mpc.next(&mut cost, &row(0.0, 100.0)).unwrap();
    assert_eq!(cost.plans, 4, "nothing is left of an episode that is over");
    assert_eq!(mpc.last_plan().expect("there is one").iterations, [4]);
}

/// At a deadline that has passed a solver makes one iteration; with much time it makes all of them.
#[test]
fn a_deadline_ends_every_solver_with_the_plan_of_the_iterations_made() {
    let real = Space::uniform_box(Dtype::F32, &[2], -2.0, 2.0);
    let integers = Space::Discrete { n: 5, start: 0 };
    let config = || PlanConfig { horizon: 6, receding_horizon: 1, action_block: 1, ..PlanConfig::default() };
    let plan = |entry: &swm_solvers::SolverEntry, iterations: u64, time: Option<Duration>| {
        let mut given = Map::new();
        if entry.name != "lagrangian" {
            given.insert("iterations".to_owned(), iterations.into());
        }
        let solver = entry.make(given).unwrap();
        let is_real = solver.check(&real).is_ok();
        let space = if is_real { real.clone() } else { integers.clone() };
        let mut mpc = Mpc::new(solver, config(), space).unwrap();
        if let Some(time) = time {
            mpc = mpc.with_deadline(time);
        }
        let (mut steps, mut chain) = (
            ControlCost::new(Navigation::past_one_obstacle()),
            ControlCost::new(DiscreteChain::quarter_steps()),
        );
        let cost: &mut dyn Cost = if is_real { &mut steps } else { &mut chain };
        mpc.next(cost, None).unwrap();
        mpc.last_plan().expect("a plan was made").clone()
    };
    // Those that need a model's states have tests of their own.
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        let cut = plan(entry, 9, Some(Duration::ZERO));
        assert_eq!(cut.iterations, [1], "{}", entry.name);
        assert!(cut.cost_of_returned[0].is_finite(), "{}", entry.name);
        let whole = plan(entry, 9, None);
        assert!(whole.iterations[0] > 1, "{}: {:?}", entry.name, whole.iterations);
        assert_eq!(plan(entry, 9, Some(Duration::MAX)), whole, "{}", entry.name);
        // These treat their last iteration or their first rounds in a way of their own.
        if !["icem", "lagrangian"].contains(&entry.name) {
            assert_eq!(cut, plan(entry, 1, None), "{}", entry.name);
        }
    }
}

#[test]
fn a_body_passes_an_obstacle_at_50_hz() {
    let mut mpc = Mpc::new(Box::new(model::solver()), model::config(), model::actions()).unwrap();
    let mut cost = ControlCost::new(Body { now: [0.0; 4] });
    let mut steps = 0;
    while Body::distance(&cost.model.now, GOAL) > 0.05 {
        let action = mpc.next(&mut cost, None).unwrap();
        assert!(action.iter().all(|value| f64::from(value.abs()) <= model::LARGEST));
        let action = [f64::from(action[0]), f64::from(action[1])];
        cost.model.now = Body::after(&cost.model.now, action);
        assert!(Body::distance(&cost.model.now, OBSTACLE) > RADIUS, "step {steps}: {:?}", cost.model.now);
        steps += 1;
        assert!(steps < 250, "{:?} after 5 s", cost.model.now);
    }
    let straight = GOAL[0] / model::LARGEST;
    assert!(f64::from(steps) * model::STEP_S > straight.sqrt(), "no faster than accelerations allow");
}

#[test]
fn actions_have_the_bounds_and_types_of_their_space() {
    /// Wants far more than there is.
    struct Eager;
    impl Cost for Eager {
        fn evaluate(
            &mut self,
            candidates: &Candidates<'_>,
            outputs: &mut Outputs<'_>,
        ) -> Result<(), PlanError> {
            for (plan, cost) in candidates.plans().zip(outputs.costs.iter_mut()) {
                *cost = plan.iter().map(|&value| (f64::from(value) - 50.0).powi(2)).sum();
            }
            Ok(())
        }
    }
    let config = PlanConfig { horizon: 2, receding_horizon: 1, action_block: 1, ..PlanConfig::default() };
    let wide = Cem { sigma: 30.0, ..cem() };
    let space = Space::Box { dtype: Dtype::F64, shape: vec![2], low: vec![-1.0, 0.0], high: vec![0.5, 2.0] };
    let mut mpc = Mpc::new(Box::new(wide.clone()), config.clone(), space.clone()).unwrap();
    assert_eq!(mpc.next(&mut Eager, None).unwrap(), [0.5, 2.0]);
    let free = PlanConfig { clip_actions: false, ..config.clone() };
    let mut mpc = Mpc::new(Box::new(wide), free, space).unwrap();
    assert!(mpc.next(&mut Eager, None).unwrap().iter().all(|&value| value > 5.0));

    let integers = Space::Discrete { n: 5, start: 3 };
    let solver = SOLVERS.iter().find(|entry| entry.name == "categorical-cem").unwrap();
    let mut mpc = Mpc::new(solver.make(Map::new()).unwrap(), config, integers).unwrap();
    let mut chain = ControlCost::new(DiscreteChain::quarter_steps());
    let (best, _) = chain.model.enumerate(0, 2);
    assert_eq!(mpc.next(&mut chain, None).unwrap(), [best[0] as f32 + 3.0]);
}

#[test]
fn no_observation_is_none_of_an_earlier_call() {
    let config = PlanConfig { history_len: 1, ..config() };
    let mut mpc = Mpc::new(Box::new(cem()), config, line()).unwrap();
    let mut cost = Homing::default();
    mpc.next(&mut cost, &row(1.0, 2.0)).unwrap();
    mpc.next(&mut cost, None).expect("the second action of the plan needs no observation");
    let refused = mpc.next(&mut cost, None).unwrap_err().to_string();
    assert!(refused.starts_with("`the observation` must be a row of state float64 [1]"), "{refused}");
    assert!(refused.ends_with("found none: `next` got no observation"), "{refused}");
    mpc.next(&mut cost, &row(1.0, 2.0)).expect("it goes on");
    assert_eq!(cost.plans, 2);

    mpc.reset();
    let refused = mpc.next(&mut cost, None).unwrap_err().to_string();
    assert!(refused.contains("`state`") && refused.contains("`next` got no observation"), "{refused}");
    mpc.next(&mut cost, &row(1.0, 2.0)).expect("the episode has its first observation");
    mpc.next(&mut cost, None).expect("the second action of the plan needs no observation");
}

/// Blocks of several actions are asked for by `action_block`; a wider action is another action.
#[test]
fn actions_of_another_size_than_the_models_are_refused() {
    let config =
        |action_block| PlanConfig { horizon: 4, receding_horizon: 1, action_block, ..PlanConfig::default() };
    let next = |cost: &mut dyn Cost, width, action_block| {
        let space = Space::uniform_box(Dtype::F32, &[width], -1.0, 1.0);
        let mut mpc = Mpc::new(Box::new(cem()), config(action_block), space).unwrap();
        mpc.next(cost, None).map(<[f32]>::len).map_err(|error| error.to_string())
    };
    let mut steps = ControlCost::new(Navigation::past_one_obstacle());
    let goals = Stepwise::new(Navigation::past_one_obstacle(), vec![vec![1.0; 2]]).unwrap();
    let mut shooting = ShootingCost::new(goals, Box::new(ControlPenalty), Vec::new()).unwrap();
    let costs: [&mut dyn Cost; 2] = [&mut steps, &mut shooting];
    for cost in costs {
        for width in [1, 3, 4] {
            let refused = next(cost, width, 2).unwrap_err();
            let sizes = format!("actions of {width} values of a plan, where the model takes actions of 2");
            assert!(refused.starts_with(&sizes) && refused.contains("action_block"), "{refused}");
        }
        assert_eq!((next(cost, 2, 1), next(cost, 2, 2)), (Ok(2), Ok(2)));
    }
}

#[test]
fn wrong_observations_and_settings_are_refused() {
    let mut mpc = Mpc::new(Box::new(cem()), config(), line()).unwrap();
    let mut cost = Homing::default();
    let refused = mpc.next(&mut cost, None).unwrap_err().to_string();
    assert!(refused.contains("`state`") && refused.contains("`next` got no observation"), "{refused}");
    mpc.next(&mut cost, &row(1.0, 2.0)).unwrap();
    let force = Schema::new(vec![Field::step("force", Dtype::F32, &[3])]).unwrap();
    let refused = mpc.next(&mut cost, &Batch::new(force, 1)).unwrap_err().to_string();
    let expected = "`the observation` must be a row of state float64 [1], goal_state float64 [1], found a row of force float32 [3]";
    assert_eq!(refused, expected);
    let two = Batch::new(row(1.0, 2.0).schema().clone(), 2);
    let refused = mpc.next(&mut cost, &two).unwrap_err().to_string();
    assert_eq!(refused, "`the observation` must be 1 rows, found 2 rows");
    mpc.next(&mut cost, &row(1.0, 2.0)).expect("it goes on");

    let simulator = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default());
    let mut mpc = Mpc::new(Box::new(cem()), config(), line()).unwrap();
    let refused = mpc.next(&mut simulator.unwrap(), &row(1.0, 2.0)).unwrap_err().to_string();
    assert!(refused.contains("`swm/Toy-v0`") && refused.contains("plan on a model"), "{refused}");

    let longer = PlanConfig { receding_horizon: 6, ..config() };
    let refused = Mpc::new(Box::new(cem()), longer, line()).err().expect("6 of 5 blocks").to_string();
    assert!(refused.contains("receding_horizon"), "{refused}");
    let refused = Mpc::new(Box::new(cem()), config(), Space::Discrete { n: 3, start: 0 });
    assert!(matches!(refused.err(), Some(PlanError::Space { .. })));
}

#[test]
fn a_trace_sees_its_plans() {
    let memory = std::sync::Arc::new(std::sync::Mutex::new(Memory::default()));
    let mut mpc =
        Mpc::new(Box::new(cem()), config(), line()).unwrap().with_trace(std::sync::Arc::clone(&memory));
    mpc.next(&mut Homing::default(), &row(0.0, 3.0)).unwrap();
    assert_eq!(memory.lock().unwrap().plans().len(), 1);
}
