//! Writing beside stepping: finished episodes wait in a queue, which the world's threads empty, one episode at a time and in
//! order, while others step.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use rayon::{Scope, Yield};

use super::sink::{EpisodeSink, Output};
use super::{EncodedBatch, Metadata, RowEncoder};
use crate::batch::Schema;
use crate::error::BoxError;

/// So many bytes of episodes may wait; one that is larger waits alone.
const MOST_WAITING_BYTES: usize = 256 << 20;

/// Episodes on their way to a sink.
pub(super) struct Queue<'a> {
    sink: Mutex<&'a mut dyn EpisodeSink>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<EncodedBatch>,
    /// Memory to be filled again.
    spare: Vec<EncodedBatch>,
    /// Whether a thread writes, or soon will.
    is_writing: bool,
    /// Why nothing more is written.
    failed: Option<BoxError>,
}

impl<'a> Queue<'a> {
    pub(super) fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self { sink: Mutex::new(sink), state: Mutex::default() }
    }

    fn sink(&self) -> MutexGuard<'_, &'a mut dyn EpisodeSink> {
        self.sink.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the next episode, and has the one behind it written by whichever thread is free then.
    fn write_next<'s>(&'s self, scope: &Scope<'s>) {
        let Some(rows) = self.state().waiting.pop_front() else { return };
        let written = catch_unwind(AssertUnwindSafe(|| self.sink().write_encoded_episode(&rows)));
        // A panic ends the run, too: whoever waits for this episode must hear of it.
        let (failed, panic) = match written {
            Ok(written) => (written.err(), None),
            Err(panic) => (Some("writing an episode panicked".into()), Some(panic)),
        };
        let mut state = self.state();
        state.spare.push(rows);
        if failed.is_some() {
            state.failed = failed;
            state.waiting.clear();
        }
        state.is_writing = !state.waiting.is_empty();
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
}

impl State {
    fn has_room(&self) -> bool {
        let bytes: usize = self.waiting.iter().map(EncodedBatch::bytes).sum();
        self.waiting.len() <= 1 || bytes <= MOST_WAITING_BYTES
    }
}

/// The near end of a queue: what a recorder on one of the world's threads hands its episodes to.
pub(super) struct Beside<'s, 'scope> {
    pub(super) queue: &'scope Queue<'scope>,
    pub(super) scope: &'s Scope<'scope>,
}

impl Output for Beside<'_, '_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        self.queue.sink().begin(schema, metadata)
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

    fn write(&mut self, rows: EncodedBatch) -> Result<(), BoxError> {
        let queue = self.queue;
        let mut state = queue.state();
        state.waiting.push_back(rows);
        let is_writing = std::mem::replace(&mut state.is_writing, true);
        drop(state);
        if !is_writing {
            self.scope.spawn(|scope| queue.write_next(scope));
        }
        queue.help_until(State::has_room)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.queue.help_until(|state| !state.is_writing)?;
        self.queue.sink().finish()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::time::Duration;

    use super::*;
    use crate::batch::Batch;
    use crate::error::WorldError;
    use crate::policies;
    use crate::recorder::{LiveStep, Recorder};
    use crate::run::{EpisodeEnd, Rollout, WorldOptions};
    use crate::testing::TOY;
    use crate::world::World;

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
        world.set_policy(policies::random());
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

    /// Tells of every step.
    struct Told(Sender<u64>);

    impl Recorder for Told {
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
        record(2, &mut sink, &mut Told(steps)).unwrap();
        assert_eq!(sink.episodes.len(), 10);
    }
}
