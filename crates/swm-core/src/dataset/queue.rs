//! Writing beside stepping: finished episodes wait in a queue, which the world's threads empty, one episode at a time and in
//! order, while others step.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;

use rayon::{Scope, Yield};

use super::sink::{EpisodeSink, InOrder, Output};
use super::{EncodedBatch, Metadata, RowEncoder};
use crate::batch::Schema;
use crate::error::BoxError;
use crate::threads::lock;

/// So many bytes of episodes may wait; one that is larger waits alone.
const MOST_WAITING_BYTES: usize = 256 << 20;

/// Episodes on their way to a sink.
pub(super) struct Queue<'a> {
    sink: Mutex<&'a mut dyn EpisodeSink>,
    state: Mutex<State>,
    most_waiting_bytes: usize,
}

#[derive(Default)]
struct State {
    order: InOrder,
    /// Memory to be filled again.
    spare: Vec<EncodedBatch>,
    /// Whether a thread writes, or soon will.
    is_writing: bool,
    /// After a failure nothing more is written.
    is_over: bool,
    /// Why, until somebody has been told.
    failed: Option<BoxError>,
}

impl<'a> Queue<'a> {
    pub(super) fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self { sink: Mutex::new(sink), state: Mutex::default(), most_waiting_bytes: MOST_WAITING_BYTES }
    }

    fn sink(&self) -> MutexGuard<'_, &'a mut dyn EpisodeSink> {
        lock(&self.sink)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    /// Writes the next episode, and has the one behind it written by whichever thread is free then.
    fn write_next<'s>(&'s self, scope: &Scope<'s>) {
        let Some(rows) = self.state().order.take() else { return };
        let written = catch_unwind(AssertUnwindSafe(|| self.sink().write_encoded_episode(&rows)));
        // A panic ends the run, too: whoever waits for this episode must hear of it.
        let (failed, panic) = match written {
            Ok(written) => (written.err(), None),
            Err(panic) => (Some("writing an episode panicked".into()), Some(panic)),
        };
        let mut state = self.state();
        state.spare.push(rows);
        if failed.is_some() {
            (state.failed, state.is_over) = (failed, true);
        }
        state.is_writing = state.may_write();
        let goes_on = state.is_writing;
        drop(state);
        if let Some(panic) = panic {
            resume_unwind(panic);
        }
        if goes_on {
            scope.spawn(|scope| self.write_next(scope));
        }
    }

    /// Lends this thread to the world's other work until `is_enough`; then the reason why an episode was not written.
    fn help_until(&self, is_enough: impl Fn(&State) -> bool) -> Result<(), BoxError> {
        loop {
            let mut state = self.state();
            if let Some(error) = state.failed.take() {
                return Err(error);
            }
            if is_enough(&state) {
                return Ok(());
            }
            drop(state);
            if rayon::yield_now() != Some(Yield::Executed) {
                thread::yield_now();
            }
        }
    }

    fn has_room(&self, state: &State) -> bool {
        state.is_over || state.order.len() <= 1 || state.order.bytes() <= self.most_waiting_bytes
    }
}

impl State {
    fn may_write(&self) -> bool {
        !self.is_over && self.order.has_next()
    }
}

/// Puts the episodes of a recorder on one of the world's threads into a queue.
pub(super) struct QueuedOutput<'s, 'scope> {
    queue: &'scope Queue<'scope>,
    scope: &'s Scope<'scope>,
    /// Whether it waits for room.
    waits: bool,
}

impl<'s, 'scope> QueuedOutput<'s, 'scope> {
    pub(super) fn new(queue: &'scope Queue<'scope>, scope: &'s Scope<'scope>) -> Self {
        Self { queue, scope, waits: true }
    }
}

impl Output for QueuedOutput<'_, '_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        let held = self.queue.sink().begin(schema, metadata)?;
        self.queue.state().order = InOrder::from(held);
        Ok(held)
    }

    fn holds(&self, column: &str) -> bool {
        self.queue.sink().holds(column)
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.queue.sink().row_encoder(column)
    }

    fn spare(&mut self) -> Option<EncodedBatch> {
        self.queue.state().spare.pop()
    }

    fn write(&mut self, episode: u64, rows: EncodedBatch) -> Result<(), BoxError> {
        let queue = self.queue;
        let mut state = queue.state();
        state.order.put(episode, rows);
        let begins = !state.is_writing && state.may_write();
        state.is_writing |= begins;
        drop(state);
        if begins {
            self.scope.spawn(|scope| queue.write_next(scope));
        }
        // Where none is written, they wait for an episode that this thread must go on with.
        queue.help_until(|state| !self.waits || !state.is_writing || queue.has_room(state))
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.queue.help_until(|state| !state.is_writing)?;
        self.queue.sink().finish()
    }

    fn part(&self) -> Option<Box<dyn Output + '_>> {
        Some(Box::new(Self { waits: false, ..*self }))
    }

    fn has_room(&self) -> bool {
        self.queue.has_room(&self.queue.state())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::time::Duration;

    use super::*;
    use crate::batch::{Batch, Value};
    use crate::env::ResetOptions;
    use crate::error::WorldError;
    use crate::policies;
    use crate::policy::{scripted, write_action};
    use crate::recorder::{LiveStep, Recorder};
    use crate::run::{EpisodeEnd, Rollout, WorldOptions};
    use crate::testing::TOY;
    use crate::world::{SharedRecorder, World};

    /// Keeps the states of every episode; `before` runs first, with the number of episodes before.
    struct Kept<F> {
        episodes: Vec<Vec<f64>>,
        before: F,
        is_finished: bool,
    }

    impl<F: FnMut(usize) -> Result<(), BoxError> + Send> EpisodeSink for Kept<F> {
        fn begin(&mut self, _schema: &Arc<Schema>, _metadata: &Metadata) -> Result<u64, BoxError> {
            Ok(0)
        }

        fn holds(&self, _column: &str) -> bool {
            false
        }

        fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
            (self.before)(self.episodes.len())?;
            self.episodes.push(rows.get::<f64>("state")?.to_vec());
            Ok(())
        }

        fn finish(&mut self) -> Result<(), BoxError> {
            self.is_finished = true;
            Ok(())
        }
    }

    fn keep<F>(before: F) -> Kept<F> {
        Kept { episodes: Vec::new(), before, is_finished: false }
    }

    fn record(
        threads: usize,
        sink: &mut dyn EpisodeSink,
        watcher: &mut dyn Recorder,
    ) -> Result<(), WorldError> {
        let options = WorldOptions::new(3).threads(threads).max_episode_steps(20);
        let mut world = World::new(&TOY, options).expect("the toy is made");
        world.set_policy(policies::random())?;
        world.record_dataset_with(&Rollout::new(0..10).seed(5), sink, watcher)
    }

    #[test]
    fn several_threads_write_what_one_does_in_the_same_order() {
        let (mut one, mut three) = (keep(|_| Ok(())), keep(|_| Ok(())));
        record(1, &mut one, &mut ()).unwrap();
        record(3, &mut three, &mut ()).unwrap();
        assert_eq!(one.episodes.len(), 10);
        assert_eq!(one.episodes, three.episodes);
        assert!(one.is_finished && three.is_finished);
    }

    #[test]
    fn nothing_is_written_after_an_episode_that_could_not_be() {
        for threads in [1, 3] {
            let mut sink = keep(|index| if index == 4 { Err("the disk is full".into()) } else { Ok(()) });
            let error = record(threads, &mut sink, &mut ()).unwrap_err();
            assert!(matches!(error, WorldError::Record(error) if error.to_string() == "the disk is full"));
            assert_eq!((sink.episodes.len(), sink.is_finished), (4, false), "{threads} threads");
        }
    }

    #[test]
    #[should_panic(expected = "a sink's own mistake")]
    fn a_panic_of_the_sink_is_the_runs() {
        let mut sink = keep(|index| if index == 2 { panic!("a sink's own mistake") } else { Ok(()) });
        _ = record(2, &mut sink, &mut ());
    }

    /// Sends the episode of every step.
    struct StepSender(Sender<u64>);

    impl Recorder for StepSender {
        fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
            // Nobody listens to the end.
            _ = self.0.send(row.episode.index);
            Ok(())
        }

        fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
            Ok(())
        }
    }

    #[test]
    fn later_episodes_are_stepped_while_one_is_written() {
        let (steps, seen): (_, Receiver<u64>) = channel();
        let mut sink = keep(move |index| {
            // The first write goes on until an episode is stepped that begins only when another has ended.
            while index == 0 && seen.recv_timeout(Duration::from_secs(60))? < 3 {}
            Ok(())
        });
        record(2, &mut sink, &mut StepSender(steps)).unwrap();
        assert_eq!(sink.episodes.len(), 10);
    }

    #[test]
    fn few_episodes_begin_while_one_is_waited_for() {
        let newest = Arc::new(AtomicU64::new(0));
        let seen = Arc::clone(&newest);
        let options = WorldOptions::new(4).threads(2).max_episode_steps(20);
        let mut world = World::new(&TOY, options).expect("the toy is made");
        world
            .set_policy(scripted("the first is slow", move |view, action| {
                if view.episode.index == 0 {
                    thread::sleep(Duration::from_millis(2));
                } else {
                    newest.fetch_max(view.episode.index, Ordering::Relaxed);
                }
                write_action(action, &[0.0]);
                Ok(())
            }))
            .unwrap();
        let mut begun = None;
        let mut sink = keep(|index| {
            if index == 0 {
                begun = Some(seen.load(Ordering::Relaxed));
            }
            Ok(())
        });
        let queue = Queue { most_waiting_bytes: 1, ..Queue::new(&mut sink) };
        let place = |value: f64| Some([("state".to_owned(), Value::vector(&[value]))].into());
        let options = ResetOptions { start: place(0.0), goal: place(9.0), ..ResetOptions::default() };
        let rollout = Rollout::new(0..5000).options(options);
        world.record_queued(&rollout, &queue, SharedRecorder::new(&mut ())).unwrap();
        assert_eq!(sink.episodes.len(), 5000);
        // Two that have ended, one of which may wait beyond what there is room for, and those that run.
        assert!(begun.is_some_and(|begun| begun <= 8), "{begun:?}");
    }
}
