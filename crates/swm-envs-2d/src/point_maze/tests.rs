//! PointMaze as its users meet it: wrong input, goals, policies.

use serde_json::json;
use swm_core::{
    Env, EnvConfig, Episode, EpisodeSeed, PolicyContext, Registry, ResetOptions, Rollout, Slice, Value,
    World, WorldOptions,
};
use swm_fov::FactorEnv;

use super::POINT_MAZE;
use super::env::PointMaze;

fn reset(env: &mut dyn Env, options: &ResetOptions) -> Result<(), String> {
    let episode = Episode::new(EpisodeSeed::new(3), options);
    env.reset(&episode).map(|_| ()).map_err(|error| error.to_string())
}

fn row(state: [f64; 4]) -> Option<std::collections::BTreeMap<String, Value>> {
    Some([("state".to_owned(), Value::vector(&state))].into())
}

/// Success rate in percent and mean steps of a policy over `episodes`.
fn evaluate(policy: &str, options: &ResetOptions, episodes: u64, budget: u64) -> (f64, f64) {
    let options_of_world = WorldOptions::new(4).max_episode_steps(budget);
    let mut world = World::new(&POINT_MAZE, options_of_world).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..episodes).seed(5).options(options.clone());
    let result = world.evaluate(&rollout).unwrap();
    (result.success_rate, result.mean_success_steps.unwrap_or(f64::NAN))
}

#[test]
fn cells_in_walls_are_errors_that_name_factor_and_layout() {
    let mut env = FactorEnv::<PointMaze>::new(&EnvConfig::default()).unwrap();
    let cell =
        |name: &str, cell: [i64; 2]| ResetOptions::default().vary(["none"]).set(name, Value::vector(&cell));
    let message = reset(&mut env, &cell("agent.start_cell", [1, 3])).unwrap_err();
    assert!(
        message.contains("agent.start_cell") && message.contains("a free cell of maze.layout"),
        "{message}"
    );
    let message = reset(&mut env, &cell("goal.cell", [1, 1])).unwrap_err();
    assert!(message.contains("goal.cell") && message.contains("other than agent.start_cell"), "{message}");
    let message = reset(&mut env, &cell("goal.cell", [11, 1])).unwrap_err();
    assert!(message.contains("goal.cell"), "{message}");
    assert!(reset(&mut env, &cell("goal.cell", [6, 6])).is_ok());
}

#[test]
fn recorded_rows_start_and_end_episodes_exactly() {
    let mut env = FactorEnv::<PointMaze>::new(&EnvConfig::default()).unwrap();
    let options = ResetOptions {
        start: row([0.5, 3.25, -1.5, 0.75]),
        goal: row([4.0, 4.0, 9.0, 9.0]),
        ..ResetOptions::default()
    };
    reset(&mut env, &options).unwrap();
    assert_eq!(env.state().state(), [0.5, 3.25, -1.5, 0.75]);
    assert_eq!(env.state().goal, [4.0, 4.0]);
    for (start, part) in [([8.0, 0.0, 0.0, 0.0], "lies in a wall"), ([f64::NAN, 0.0, 0.0, 0.0], "not finite")]
    {
        let message =
            reset(&mut env, &ResetOptions { start: row(start), ..ResetOptions::default() }).unwrap_err();
        assert!(message.contains(part) && message.contains("start"), "{message}");
    }
    let nothing = ResetOptions { goal: Some(Default::default()), ..ResetOptions::default() };
    assert!(reset(&mut env, &nothing).unwrap_err().contains("column `state`"));
}

#[test]
fn reaching_the_goal_ends_the_episode_unless_told_otherwise() {
    for terminates in [true, false] {
        let mut config = EnvConfig::default();
        config.settings.insert("terminate_at_goal".to_owned(), json!(terminates));
        let mut env = FactorEnv::<PointMaze>::new(&config).unwrap();
        let options = ResetOptions {
            start: row([0.0, 0.0, 0.0, 0.0]),
            goal: row([1.2, 0.0, 0.0, 0.0]),
            ..ResetOptions::default()
        };
        reset(&mut env, &options).unwrap();
        let far = env.task_cost().unwrap();
        let outcome = (0..10)
            .map(|_| env.step(Slice::F32(&[1.0, 0.0])).unwrap())
            .find(|outcome| outcome.success == Some(true))
            .expect("the goal is ahead");
        assert_eq!((outcome.reward, outcome.terminated), (0.0, terminates));
        assert!(env.task_cost().unwrap() < far);
    }
}

#[test]
fn the_expert_reaches_goals_in_every_layout() {
    for layout in 0..4_i64 {
        let options = ResetOptions::default()
            .vary(["agent.start_cell", "agent.start_offset", "goal.cell", "goal.offset"])
            .set("maze.layout", Value::scalar(layout));
        let (success, steps) = evaluate("expert", &options, 20, 400);
        assert!(success >= 95.0, "layout {layout}: {success} %, {steps} steps");
    }
}

#[test]
fn the_expert_copes_with_every_factor_and_with_noise() {
    let everything = ResetOptions::default().vary(["all"]);
    let (success, steps) = evaluate("expert", &everything, 40, 400);
    assert!(success >= 95.0, "{success} %, {steps} steps");
    let (success, _) = evaluate("noisy-expert:0.5", &ResetOptions::default(), 20, 400);
    assert!(success >= 95.0, "{success} % with noise");
}

#[test]
fn explorers_wander_and_wrong_arguments_are_refused() {
    let (explorer, _) = evaluate("explorer", &ResetOptions::default(), 30, 100);
    let (random, _) = evaluate("random", &ResetOptions::default(), 30, 100);
    assert!(explorer > random, "{explorer} % find the goal by wandering, {random} % by chance");
    let config = EnvConfig::default();
    let context = PolicyContext::new(&POINT_MAZE, &config);
    for (policy, part) in
        [("explorer:-1", "std -1"), ("expert:std=1", "std"), ("noisy-expert:1,2", "second value")]
    {
        let made = Registry::new().policy(policy, context);
        let message = made.err().expect("it is wrong").to_string();
        assert!(message.contains(part), "{policy}: {message}");
    }
}
