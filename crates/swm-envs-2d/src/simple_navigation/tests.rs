//! What SimpleNavigation promises beyond conformance. That steps and images are the reference's is checked by its golden
//! trajectories.

use std::fs::File;

use ndarray::{ArrayD, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadableElement};
use swm_core::{
    Env as _, EnvConfig, Episode, EpisodeSeed, Registry, ResetOptions, Rollout, Slice, Value, World,
    WorldOptions,
};
use swm_fov::FactorEnv;

use super::env::{FORWARD, LEFT, RIGHT};
use super::maze::{Maze, SIDE};
use super::{SIMPLE_NAVIGATION, SimpleNavigation};

/// One of the mazes.
fn maze() -> Maze {
    Maze::new(4, 0.5, 0.5)
}

fn success(policy: &str, budget: u64) -> f64 {
    let options = WorldOptions::new(4).max_episode_steps(budget);
    let mut world = World::new(&SIMPLE_NAVIGATION, options).unwrap();
    world.set_policy(Registry::new().policy(policy, &world).unwrap()).unwrap();
    world.evaluate(&Rollout::new(0..100).seed(3)).unwrap().success_rate
}

#[test]
fn the_expert_finds_every_goal() {
    assert_eq!(success("expert", 60), 100.0);
    assert_eq!(success("noisy-expert:0.3", 300), 100.0);
    assert!(success("random", 60) < 50.0);
}

#[test]
fn every_maze_has_one_way_between_any_two_cells() {
    let mut passages = [0, 0];
    for seed in 0..200 {
        for (index, (across, down)) in [(0.5, 0.5), (0.0, 0.0), (1.0, 1.0)].into_iter().enumerate() {
            let maze = Maze::new(seed, across, down);
            let free: Vec<[i64; 2]> = (0..SIDE * SIDE)
                .map(|i| [(i % SIDE) as i64, (i / SIDE) as i64])
                .filter(|&cell| maze.is_free(cell))
                .collect();
            // 16 rooms and 15 passages, all connected: a tree.
            assert_eq!(free.len(), 31, "seed {seed}");
            let distances = maze.distances([1, 1]);
            assert!(free.iter().all(|&cell| distances.actions(cell, 0).is_some()), "seed {seed}");
            assert_eq!(Maze::from_walls(&maze.walls), Ok(maze));
            let across = free.iter().filter(|[x, y]| x % 2 == 0 && y % 2 == 1 && *y < 7).count();
            if index > 0 {
                passages[index - 1] += across;
            }
        }
    }
    // Passages across in rows above the last: none, or the first row is all connected, and no other needs any.
    assert_eq!(passages, [0, 200 * 3]);
}

#[test]
fn actions_turn_and_walk_and_walls_stop() {
    let mut env = FactorEnv::<SimpleNavigation>::new(&EnvConfig::default()).unwrap();
    let mut walls = [1_u8; SIDE * SIDE];
    for x in 1..8 {
        walls[SIDE + x] = 0;
    }
    let walls = Value { shape: vec![SIDE, SIDE], ..Value::vector(&walls) };
    let start = [("state".to_owned(), Value::vector(&[5_i64, 1, 3, 7, 1])), ("walls".to_owned(), walls)];
    let goal = [("state".to_owned(), Value::vector(&[7_i64, 1, 0, 7, 1]))];
    let options =
        ResetOptions { start: Some(start.into()), goal: Some(goal.into()), ..ResetOptions::default() };
    env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
    assert_eq!(env.task_cost(), Some(3.0));
    let mut step = |action: i64| {
        let outcome = env.step(Slice::I64(&[action])).unwrap();
        (outcome.reward, outcome.terminated, env.task_cost().unwrap())
    };
    assert_eq!(step(FORWARD), (-2.0, false, 3.0));
    assert_eq!(step(LEFT), (-2.0, false, 4.0));
    assert_eq!(
        [step(RIGHT), step(RIGHT), step(FORWARD)],
        [(-2.0, false, 3.0), (-2.0, false, 2.0), (-1.0, false, 1.0)]
    );
    assert_eq!(step(FORWARD), (0.0, true, 0.0));
}

#[test]
fn the_last_row_of_an_episode_is_a_start_too() {
    let mut env = FactorEnv::<SimpleNavigation>::new(&EnvConfig::default()).unwrap();
    let start = [("state".to_owned(), Value::vector(&[7_i64, 7, 2, 7, 7]))];
    let options = ResetOptions { start: Some(start.into()), ..ResetOptions::default() }.vary(["none"]);
    let outcome = env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap();
    assert_eq!((outcome.success, env.task_cost()), (Some(true), Some(0.0)));
}

#[test]
fn wrong_starts_mazes_and_actions_are_refused() {
    let mut env = FactorEnv::<SimpleNavigation>::new(&EnvConfig::default()).unwrap();
    let mut refused = |start: Vec<(&str, Value)>| {
        let start = start.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let options = ResetOptions { start: Some(start), ..ResetOptions::default() };
        env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap_err().to_string()
    };
    let state = |x: i64, y: i64| ("state", Value::vector(&[x, y, 0, 7, 7]));
    let message = refused(vec![state(8, 1)]);
    assert!(message.contains("column 8") && message.contains("1 to 7"), "{message}");
    let message = refused(vec![state(2, 2)]);
    assert!(message.contains("[2, 2] is a wall") && message.contains("`walls`"), "{message}");
    let mut open = maze().walls;
    open[3] = 0;
    let open = Value { shape: vec![SIDE, SIDE], ..Value::vector(&open) };
    let message = refused(vec![state(1, 1), ("walls", open)]);
    assert!(message.contains("[3, 0] of the border is no wall"), "{message}");
    assert!(refused(vec![]).contains("needs the column `state`"));
    assert!(env.step(Slice::I64(&[3])).unwrap_err().to_string().contains("no action"));
    let options = ResetOptions::default().vary(["none"]).set("agent.position", Value::vector(&[2_i64, 2]));
    let error = env.reset(&Episode::new(EpisodeSeed::new(1), &options)).unwrap_err();
    assert!(error.to_string().contains("no wall (cells of odd column and row never are)"), "{error}");
}

#[test]
fn the_expert_acts_as_the_recorded_one() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/simple/SimpleNavigation.npz");
    let mut npz = NpzReader::new(File::open(path).expect(path)).unwrap();
    for run in ["default_seed0", "default_seed1", "default_seed2"] {
        let maze = Maze::from_walls(&list::<u8>(&mut npz, &format!("{run}/walls"))).unwrap();
        let states: Vec<i64> = list(&mut npz, &format!("{run}/state"));
        let [mut x, mut y, mut direction, to_x, to_y] = states[..5].try_into().unwrap();
        let distances = maze.distances([to_x, to_y]);
        let recorded: Vec<i64> = list(&mut npz, &format!("{run}/expert_actions"));
        assert_eq!(distances.actions([x, y], direction), Some(recorded.len() as u32), "{run}");
        for action in recorded {
            let wanted = distances.direction([x, y]).expect("the goal is not reached yet");
            let expected = [FORWARD, RIGHT, RIGHT, LEFT][(wanted - direction).rem_euclid(4) as usize];
            assert_eq!(action, expected, "{run} at [{x}, {y}]");
            match action {
                LEFT => direction = (direction + 3) % 4,
                RIGHT => direction = (direction + 1) % 4,
                _ => [x, y] = super::maze::next_to([x, y], direction),
            }
        }
        assert_eq!([x, y], [to_x, to_y], "{run}");
    }
}

fn list<T: ReadableElement + Clone>(npz: &mut NpzReader<File>, name: &str) -> Vec<T> {
    let array: ArrayD<T> = npz.by_name::<OwnedRepr<T>, IxDyn>(name).unwrap();
    array.iter().cloned().collect()
}
