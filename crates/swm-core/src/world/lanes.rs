//! Environments that do not wait for each other. Where the policy acts in each by itself, each has a loop of its own, a lane,
//! and the threads take turns with the lanes.

use std::collections::VecDeque;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rayon::Yield;

use super::split_recorder::{RecorderShard, SplitRecorder};
use super::{Run, World};
use crate::batch::Batch;
use crate::error::WorldError;
use crate::policy::Policy;
use crate::run::{Rollout, Slot};
use crate::threads::{Pace, Threads, lock};

/// A turn is at least so long, since an environment may have to move into the cache of another core for it: some 10 to 50 µs.
const TURN: Duration = Duration::from_millis(2);
/// After so many steps a turn may end.
const TURN_STEPS: usize = 8;

/// The episodes of a run that are still to begin, and those that do not go on.
pub(super) struct Upcoming {
    next: AtomicU64,
    end: u64,
    /// Episodes from here on stop.
    stop: AtomicU64,
}

impl Upcoming {
    pub(super) fn new(episodes: Range<u64>) -> Self {
        Self { next: episodes.start.into(), end: episodes.end, stop: u64::MAX.into() }
    }

    /// The next episode to begin.
    pub(super) fn take(&self) -> Option<u64> {
        let next = |next| (next < self.end).then(|| next + 1);
        self.next.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next).ok()
    }

    /// Whether none is to begin any more.
    fn is_empty(&self) -> bool {
        let next = self.next.load(Ordering::Relaxed);
        next >= self.end || self.is_stopped(next)
    }

    fn is_stopped(&self, episode: u64) -> bool {
        episode >= self.stop.load(Ordering::Relaxed)
    }

    fn stop_from(&self, episode: u64) {
        self.stop.fetch_min(episode, Ordering::Relaxed);
    }
}

/// Runs what is left of a rollout in lanes, from the first actions on; `None`: policy or recorder want to see all environments
/// at once, or there is nothing to divide.
pub(super) fn run(
    world: &mut World,
    rollout: &Rollout,
    upcoming: &Arc<Upcoming>,
    recorder: &mut dyn SplitRecorder,
) -> Option<Result<(), WorldError>> {
    let count = world.slots.len();
    if world.threads.is_one() || count == 1 {
        return None;
    }
    let shards = (0..count).map(|_| recorder.shard()).collect::<Option<Vec<_>>>()?;
    let worlds = world.divide()?;
    let lanes = (0..).zip(worlds).zip(shards);
    let mut lanes: Vec<Lane<'_>> =
        lanes.map(|((slot, world), shard)| Lane { slot, world, shard, has_actions: true }).collect();
    let ran = catch_unwind(AssertUnwindSafe(|| take_turns(&mut lanes, rollout, upcoming)));
    world.rejoin(lanes.into_iter().map(|lane| lane.world));
    let ran = ran.unwrap_or_else(|panic| resume_unwind(panic));
    Some(ran.and_then(|()| recorder.finish().map_err(WorldError::Record)))
}

/// Lets every thread take turns with the lanes until all are over. The failure of the first episode that fails is the run's:
/// episodes before it go on to their ends, those behind it stop.
fn take_turns(lanes: &mut [Lane<'_>], rollout: &Rollout, upcoming: &Arc<Upcoming>) -> Result<(), WorldError> {
    let waiting = Mutex::new(lanes.iter_mut().collect());
    let failed = Mutex::new(None);
    // A broadcast, since a task that can be stolen might begin in the midst of another's wait, and not return to it.
    rayon::broadcast(|_| {
        while let Some(lane) = next_of(&waiting) {
            let turn = catch_unwind(AssertUnwindSafe(|| lane.turn(rollout, upcoming)));
            let next = match turn {
                Ok(Ok(next)) => next,
                Ok(Err(error)) => {
                    let (episode, error) = lane.failure(error);
                    upcoming.stop_from(episode);
                    let mut failed = lock(&failed);
                    if failed.as_ref().is_none_or(|(first, _)| episode < *first) {
                        *failed = Some((episode, error));
                    }
                    Next::IsOver
                }
                Err(panic) => {
                    upcoming.stop_from(0);
                    resume_unwind(panic)
                }
            };
            let waits = matches!(next, Next::Waits);
            if !matches!(next, Next::IsOver) {
                lock(&waiting).push_back(lane);
            }
            // Whatever is ready to be written is written first: what is left to the end is written by one thread alone.
            while rayon::yield_now() == Some(Yield::Executed) {}
            if waits {
                thread::yield_now();
            }
        }
    });
    let failed = failed.into_inner().unwrap_or_else(PoisonError::into_inner);
    failed.map_or(Ok(()), |(_, error)| Err(error))
}

/// The lane that has waited longest. Where there is none, all that are not over have a thread each.
fn next_of<'s, 'a>(waiting: &Mutex<VecDeque<&'s mut Lane<'a>>>) -> Option<&'s mut Lane<'a>> {
    lock(waiting).pop_front()
}

/// What a lane does after a turn.
enum Next {
    GoesOn,
    /// Until there is room for another episode.
    Waits,
    IsOver,
}

/// One environment with its own policy and its shard of the recorder.
struct Lane<'a> {
    /// Its place in the world.
    slot: usize,
    /// Of this environment alone.
    world: World,
    shard: Box<dyn RecorderShard + 'a>,
    /// Whether the policy has acted in this step.
    has_actions: bool,
}

impl Lane<'_> {
    fn turn(&mut self, rollout: &Rollout, upcoming: &Arc<Upcoming>) -> Result<Next, WorldError> {
        let (started, mut steps) = (Instant::now(), 0);
        let mut is_over = || {
            steps += 1;
            steps % TURN_STEPS == 0 && started.elapsed() >= TURN
        };
        loop {
            let is_live = self.world.slots[0].is_live();
            if !is_live && upcoming.is_empty() {
                return Ok(Next::IsOver);
            }
            if !is_live && !self.shard.has_room() {
                return Ok(Next::Waits);
            }
            let mut run = Run {
                world: &mut self.world,
                rollout,
                recorder: &mut *self.shard,
                upcoming: Arc::clone(upcoming),
                started: true,
                has_actions: std::mem::take(&mut self.has_actions),
            };
            if !is_live {
                run.begin_due()?;
            }
            while let Some(episode) = run.world.slots[0].live_episode() {
                if upcoming.is_stopped(episode.index) {
                    return Ok(Next::IsOver);
                }
                if !run.has_actions {
                    run.act()?;
                }
                run.step()?;
                if is_over() {
                    return Ok(Next::GoesOn);
                }
            }
        }
    }

    /// Which episode failed (0: the run itself), and how, with the environment's place in the world.
    fn failure(&self, mut error: WorldError) -> (u64, WorldError) {
        let episode = match &mut error {
            WorldError::Env { slot, episode, .. } | WorldError::Action { slot, episode, .. } => {
                *slot = self.slot;
                *episode
            }
            WorldError::Policy(_) => self.world.slots[0].live_episode().map_or(0, |live| live.index),
            _ => 0,
        };
        (episode, error)
    }
}

impl World {
    /// One world for each environment, with the episode that it is in; this one keeps none.
    fn divide(&mut self) -> Option<Vec<World>> {
        let count = self.slots.len();
        let policies = self.policy.as_mut()?.divide(count)?;
        assert_eq!(policies.len(), count, "a policy that is divided has one part for each environment");
        let slots = std::mem::take(&mut self.slots);
        let part = |(row, (slot, policy))| self.of_one(row, slot, policy);
        Some((0..).zip(slots.into_iter().zip(policies)).map(part).collect())
    }

    fn of_one(&self, row: usize, slot: Slot, policy: Box<dyn Policy>) -> World {
        let mut infos = Batch::new(Arc::clone(self.infos.schema()), 1);
        infos.rows_mut().copy_row(self.infos.row(row));
        let dim = self.spec.action.dim();
        World {
            entry: self.entry,
            options: self.options.clone(),
            spec: self.spec.clone(),
            slots: vec![slot],
            infos,
            actions: self.actions.as_slice().range(row * dim, dim).to_column(),
            policy: Some(policy),
            report: Batch::new(Arc::clone(self.report.schema()), 1),
            fields: self.fields,
            judge: self.judge.clone(),
            frames: self.frames.clone(),
            policy_seed: self.policy_seed,
            pace: Pace::default(),
            threads: Threads::one(),
        }
    }

    /// Takes the environments back.
    fn rejoin(&mut self, worlds: impl Iterator<Item = World>) {
        let dim = self.spec.action.dim();
        for (row, world) in worlds.enumerate() {
            self.infos.rows_mut().select(row).copy_row(world.infos.row(0));
            let (_, mut actions) = self.actions.as_slice_mut().split_at(row * dim);
            assert!(actions.reborrow().split_at(dim).0.copy_from(world.actions()), "one space made both");
            self.slots.extend(world.slots);
        }
    }
}
