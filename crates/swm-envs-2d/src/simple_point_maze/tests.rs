//! What SimplePointMaze promises beyond conformance. That steps and images are the reference's is checked by its golden
//! trajectories.

use serde_json::json;
use swm_core::{
    Env as _, EnvConfig, EnvError, Episode, EpisodeSeed, Registry, ResetOptions, Rollout, Slice, Value,
    World, WorldOptions,
};
use swm_fov::FactorEnv;

use super::walls::{Room, Wall};
use super::{SIMPLE_POINT_MAZE, SimplePointMaze};

fn env() -> FactorEnv<SimplePointMaze> {
    FactorEnv::<SimplePointMaze>::new(&EnvConfig::default()).unwrap()
}

fn success(policy: &str, vary: &[&str]) -> f64 {
    let options = WorldOptions::new(4).max_episode_steps(200);
    let mut world = World::new(&SIMPLE_POINT_MAZE, options).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..60).seed(3);
    let rollout = if vary.is_empty() { rollout } else { rollout.vary(vary.iter().copied()) };
    world.evaluate(&rollout).unwrap().success_rate
}

#[test]
fn the_expert_goes_around_the_walls() {
    assert_eq!(success("expert", &[]), 100.0);
    assert!(success("noisy-expert", &[]) > 95.0);
    assert!(success("random", &[]) < 50.0);
    let walls = ["agent.position", "goal.position", "walls.number", "walls.shape", "walls.positions"];
    assert!(success("expert", &walls) > 90.0);
}

#[test]
fn walls_stop_the_disc_and_the_border_holds_it() {
    let wall = Wall::new([2.0, 2.0], [1.0, 1.0]);
    let room = Room { walls: vec![wall], radius: 0.1, speed: 1.0 };
    assert_eq!(room.step([1.85, 2.5], [0.2, 0.0]), [1.85, 2.5]);
    assert_eq!(room.step([1.5, 2.5], [0.2, 0.1]), [1.7, 2.6]);
    // Actions are clipped, and so are positions.
    assert_eq!(room.step([0.05, 4.9], [-9.0, 9.0]), [0.0, 5.0]);
    let [way, straight] =
        [[1.5, 2.5], [2.5, 1.5]].map(|from: [f64; 2]| room.shortest_paths([3.5, 2.5]).leg(from).length);
    assert!(way > 2.0 && straight > 2.0_f64.sqrt() && way.is_finite());
}

#[test]
fn sampled_walls_lie_in_the_room_clear_of_what_stands_still() {
    let mut env = env();
    for seed in 0..200 {
        for vary in [&["walls"][..], &["all"], &["walls.positions", "goal.position"]] {
            let options = ResetOptions::default().vary(vary);
            env.reset(&Episode::new(EpisodeSeed::new(seed), &options))
                .unwrap_or_else(|error| panic!("seed {seed}, {vary:?}: {error}"));
        }
    }
}

#[test]
fn wrong_settings_starts_and_places_are_refused() {
    let settings = json!({"render": "slow"});
    let config = EnvConfig { settings: settings.as_object().unwrap().clone(), ..EnvConfig::default() };
    assert!(SIMPLE_POINT_MAZE.make(&config).is_err());
    let mut env = env();
    let mut reset = |options: &ResetOptions| {
        env.reset(&Episode::new(EpisodeSeed::new(1), options)).map(|_| ()).map_err(|error| match error {
            EnvError::Reset { reason, .. } | EnvError::Constraint { reason, .. } => reason,
            other => panic!("{other}"),
        })
    };
    let row = [("state".to_owned(), Value::vector(&[7.0_f32, 2.0]))];
    let message = reset(&ResetOptions { start: Some(row.into()), ..ResetOptions::default() }).unwrap_err();
    assert!(message.contains("`state`") && message.contains("between 0 and 5"), "{message}");
    let in_wall =
        ResetOptions::default().vary(["none"]).set("agent.position", Value::vector(&[1.5_f32, 3.8]));
    let message = reset(&in_wall).unwrap_err();
    assert!(message.contains("agent.position") && message.contains("clear of the walls"), "{message}");
    assert!(env.step(Slice::F32(&[f32::NAN, 0.0])).is_err());
}

#[test]
fn a_recorded_position_starts_and_ends_an_episode() {
    let mut env = env();
    let row = |x: f32, y: f32| Some([("state".to_owned(), Value::vector(&[x, y]))].into());
    let options = ResetOptions { start: row(0.5, 0.6), goal: row(0.5, 1.0), ..ResetOptions::default() };
    env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
    assert!((env.task_cost().unwrap() - 0.4).abs() < 1e-6);
    let first = env.step(Slice::F32(&[0.0, 0.1])).unwrap();
    assert_eq!((first.reward, first.terminated), (-0.01, false));
    let second = env.step(Slice::F32(&[0.0, 0.2])).unwrap();
    assert_eq!((second.reward, second.terminated, second.success), (1.0, true, Some(true)));
}
