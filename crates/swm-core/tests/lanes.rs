//! Runs in which every environment has a loop of its own: nobody waits, one failure is told, and the world stays whole.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use swm_core::dataset::Metadata;
use swm_core::policy::write_action;
use swm_core::testing::TOY;
use swm_core::{
    Actor, Batch, BoxError, EpisodeSink, PerEpisode, Policy, PolicyError, ResetOptions, Rollout, Schema,
    SliceMut, SlotView, World, WorldError, WorldOptions, policies, policy,
};

fn world(num_envs: usize, threads: usize) -> World {
    World::new(&TOY, WorldOptions::new(num_envs).max_episode_steps(9).threads(threads))
        .expect("valid options")
}

#[test]
fn environments_do_not_wait_for_each_other() {
    let newest = Arc::new(AtomicU64::new(0));
    let mut world = world(3, 2);
    world
        .set_policy(policy::scripted("the first waits", move |view, action| {
            newest.fetch_max(view.episode.index, Ordering::Relaxed);
            let deadline = Instant::now() + Duration::from_secs(60);
            while view.episode.index == 0 && view.episode.step == 1 && newest.load(Ordering::Relaxed) < 7 {
                if Instant::now() > deadline {
                    return Err(PolicyError::Cancelled);
                }
                thread::yield_now();
            }
            write_action(action, &[0.0]);
            Ok(())
        }))
        .unwrap();
    assert_eq!(world.evaluate(&Rollout::new(0..20).seed(1)).unwrap().episodes, 20);
}

/// Keeps the number of rows of each episode.
#[derive(Default)]
struct Lengths(Vec<usize>);

impl EpisodeSink for Lengths {
    fn begin(&mut self, _schema: &Arc<Schema>, _metadata: &Metadata) -> Result<u64, BoxError> {
        Ok(0)
    }

    fn holds(&self, _column: &str) -> bool {
        false
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.0.push(rows.rows());
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Fails in episodes from 5 on, the earlier the later they are.
fn fails() -> impl Policy {
    policy::scripted("fails", |view, action| {
        let fails = view.episode.index >= 5 && view.episode.step + view.episode.index >= 12;
        write_action(action, &[if fails { f32::NAN } else { 0.0 }]);
        Ok(())
    })
}

#[test]
fn the_failure_is_the_first_episodes_and_those_before_it_are_committed() {
    let options = ResetOptions::default().set("point.gain", swm_core::Value::scalar(0.1));
    let rollout = Rollout::new(0..40).seed(3).options(options);
    let mut expected = Lengths::default();
    let mut whole = world(3, 2);
    whole.set_policy(policies::constant(Vec::new())).unwrap();
    whole.record_dataset(&rollout, &mut expected).unwrap();
    for (num_envs, threads) in [(2, 2), (3, 2), (8, 2), (8, 3)].repeat(20) {
        let mut world = world(num_envs, threads);
        world.set_policy(fails()).unwrap();
        let mut lengths = Lengths::default();
        match world.record_dataset(&rollout, &mut lengths) {
            Err(WorldError::Action { episode: 5, step: 7, slot, .. }) => assert!(slot < num_envs),
            other => panic!("{num_envs} environments, {threads} threads: {other:?}"),
        }
        assert_eq!(lengths.0, expected.0[..5]);
    }
}

struct Idle;

impl Actor for Idle {
    fn act(&mut self, _view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        write_action(&mut action, &[0.0]);
        Ok(())
    }
}

#[test]
fn every_episode_has_one_actor() {
    let made = Arc::new(Mutex::new(Vec::new()));
    let mut world = world(3, 2);
    world
        .set_policy(PerEpisode::new("idle", {
            let made = Arc::clone(&made);
            move |view: &SlotView<'_>| {
                made.lock().expect("no thread panicked").push(view.episode.index);
                Ok(Box::new(Idle) as Box<dyn Actor>)
            }
        }))
        .unwrap();
    world.evaluate(&Rollout::new(2..9)).unwrap();
    let mut made = made.lock().unwrap().clone();
    made.sort_unstable();
    assert_eq!(made, (2..9).collect::<Vec<_>>());
}

#[test]
fn the_world_has_all_its_environments_after_a_run_however_it_ended() {
    let mut world = world(4, 2);
    let rollout = Rollout::new(0..12).seed(3);
    let mut check = |policy: Box<dyn Policy>, ended: &dyn Fn(&mut World)| {
        world.set_policy(policy).unwrap();
        ended(&mut world);
        assert_eq!((world.infos().rows(), world.actions().len()), (4, 4));
        world.reset(1, &ResetOptions::default()).unwrap();
        world.set_policy(policies::random()).unwrap();
        world.step().unwrap();
        assert_eq!(world.infos().get::<i64>("step_idx").unwrap(), [1; 4]);
        assert!((0..4).all(|slot| world.episode(slot).is_some_and(|episode| episode.steps == 1)));
    };
    check(Box::new(policies::random()), &|world| {
        world.evaluate(&rollout).unwrap();
        let ended = |name| world.infos().get::<bool>(name).unwrap().to_vec();
        let ended = ended("terminated").into_iter().zip(ended("truncated"));
        assert!(ended.into_iter().all(|(terminated, truncated)| terminated || truncated));
    });
    check(Box::new(fails()), &|world| assert!(world.evaluate(&rollout).is_err()));
    let panics = policy::scripted("panics", |view, action| {
        assert!(view.episode.index < 7, "a policy's own mistake");
        write_action(action, &[0.0]);
        Ok(())
    });
    check(Box::new(panics), &|world| {
        let panic = catch_unwind(AssertUnwindSafe(|| world.evaluate(&rollout))).unwrap_err();
        assert!(panic.downcast_ref::<&str>().is_some_and(|said| said.contains("own mistake")));
    });
}
