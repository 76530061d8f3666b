//! Rules of success, noise of policies and shown images, on the toy environment.

use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::evaluate::{Condition, Measure, SuccessRule};
use swm_core::policy::{self, write_action};
use swm_core::testing::TOY;
use swm_core::view::{Frame, Transform};
use swm_core::{EpisodeEnd, LiveStep, Recorder, ResetOptions, Rollout, Value, World, WorldOptions, policies};

/// The point is nearer to its goal than `below`, in `hold` rows on end.
fn near(below: f64, hold: u64) -> SuccessRule {
    let (column, goal) = ("state".to_owned(), "goal_state".to_owned());
    let condition = Condition {
        column,
        goal,
        elements: Vec::new(),
        measure: Measure::Distance,
        turn: None,
        symmetry: None,
        below,
    };
    SuccessRule { hold, all: vec![condition] }
}

#[derive(Default)]
struct Ends(Vec<EpisodeEnd>);

impl Recorder for Ends {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.0.push(*end);
        Ok(())
    }
}

/// Walks from 0 towards 10 by one per step, for up to 14 steps, and never stops by itself.
fn walk(rule: &SuccessRule) -> EpisodeEnd {
    let mut world = World::new(&TOY, WorldOptions::default().max_episode_steps(14)).expect("the toy runs");
    world
        .set_policy(policy::scripted("walk", |_, action| {
            write_action(action, &[1.0]);
            Ok(())
        }))
        .expect("it begins");
    world.set_success(rule).expect("the toy runs");
    let row = |state: f64| Some([("state".to_owned(), Value::vector(&[state]))].into_iter().collect());
    let options = ResetOptions { start: row(0.0), goal: row(10.0), ..ResetOptions::default() };
    let mut ends = Ends::default();
    let rollout = Rollout::new(0..1).seed(1).options(options);
    world.run(&rollout, &mut ends).expect("the toy runs");
    ends.0[0]
}

#[test]
fn a_rule_decides_in_place_of_the_environment() {
    // Rows at 8, 9, 10, 11, 12 are within 2.5.
    let end = walk(&near(2.5, 1));
    assert_eq!(
        (end.success, end.first_success_step, end.steps, end.terminated),
        (Some(true), Some(8), 8, true)
    );
    let end = walk(&near(2.5, 4));
    assert_eq!((end.first_success_step, end.steps), (Some(8), 11), "the first of the rows that hold counts");
    let end = walk(&near(2.5, 6));
    assert_eq!(
        (end.success, end.first_success_step, end.steps, end.truncated),
        (Some(false), None, 14, true)
    );
    let margins = end.margins.unwrap();
    assert!((margins.best, margins.last) == (0.0, 4.0 / 2.5), "{margins:?}");
    let end = walk(&near(100.0, 1));
    assert_eq!((end.success_at_start, end.first_success_step), (Some(true), Some(0)));
    // The environment's own rule ends the episode where it does.
    let own = walk(&SuccessRule::default());
    assert!(own.success == Some(true) && own.margins.is_none(), "{own:?}");
}

#[test]
fn the_noise_of_a_policy_has_a_seed_of_its_own() {
    let run = |seed: u64, num_envs: usize| {
        let mut world = World::new(&TOY, WorldOptions::new(num_envs).max_episode_steps(5)).unwrap();
        world.set_policy(policies::random()).unwrap();
        world.set_policy_seed(seed);
        let mut log = Log::default();
        world.run(&Rollout::new(0..6).seed(3), &mut log).unwrap();
        log.0.sort_by_key(|row| (row.0, row.1));
        log.0
    };
    let (a, b) = (run(0, 1), run(7, 1));
    let starts = |log: &[(u64, u64, f64, f32)]| -> Vec<f64> {
        log.iter().filter(|row| row.1 == 0).map(|row| row.2).collect()
    };
    assert_eq!(starts(&a), starts(&b), "the episodes are the same");
    assert!(a.iter().zip(&b).any(|(a, b)| a.3 != b.3), "the actions are not");
    let same = |a: &[(u64, u64, f64, f32)], b: &[(u64, u64, f64, f32)]| {
        a.iter().zip(b).all(|(a, b)| {
            (a.0, a.1, a.2.to_bits(), a.3.to_bits()) == (b.0, b.1, b.2.to_bits(), b.3.to_bits())
        })
    };
    assert!(same(&b, &run(7, 4)), "whatever the number of environments");
}

/// Episode, step, state, action of every row.
#[derive(Default)]
struct Log(Vec<(u64, u64, f64, f32)>);

impl Recorder for Log {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let (state, action) = (row.values.get::<f64>("state")?[0], row.values.get::<f32>("action")?[0]);
        self.0.push((row.episode.index, row.episode.step, state, action));
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Writes the step and the episode's seed into the first pixel.
struct Stamp;

impl Transform for Stamp {
    fn describe(&self) -> String {
        "stamp".to_owned()
    }

    fn apply(&self, frame: &mut Frame<'_>) {
        frame.pixels[..3].copy_from_slice(&[frame.step as u8, frame.height as u8, frame.seed.value() as u8]);
    }
}

#[test]
fn images_are_shown_through_a_transform_everywhere() {
    struct Seen(Vec<[u8; 3]>);
    impl Recorder for Seen {
        fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
            let pixels = row.values.get::<u8>("pixels")?;
            assert_eq!(pixels[2], row.episode.seed.value() as u8);
            self.0.push([pixels[0], pixels[1], row.episode.step as u8]);
            Ok(())
        }
        fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
            Ok(())
        }
    }
    let mut world = World::new(&TOY, WorldOptions::new(3).max_episode_steps(4).image(8, 6)).unwrap();
    world.set_policy(policies::random()).unwrap();
    world.set_transform(Some(Arc::new(Stamp)));
    let mut seen = Seen(Vec::new());
    world.run(&Rollout::new(0..5).seed(3), &mut seen).unwrap();
    assert!(seen.0.len() >= 10);
    assert!(seen.0.iter().all(|[step, height, live]| step == live && *height == 8), "{:?}", seen.0);
}
