//! The threads of a world, and how finely work is divided among them: not at all where a hand-over costs more than the
//! work, which then stays on the caller's thread.
//!
//! The cost of a slot is learned from the clock. It decides who works, never what comes out.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// Work below this many nanoseconds is not worth handing to another thread.
const WORTH_NANOS: f64 = 15_000.0;
/// Weight of the newest measurement.
const LEARNING: f64 = 0.2;
/// A measurement counts as at most this many times what is known.
const MOST_GROWTH: f64 = 4.0;

/// The threads that a world divides its work among. A single one is started when a policy first divides its work: most
/// worlds of one thread never need it.
#[derive(Clone, Debug)]
pub(crate) struct Threads {
    pool: Arc<OnceLock<ThreadPool>>,
    count: usize,
}

impl Threads {
    /// Starts them; `None`: one per core.
    pub(crate) fn new(count: Option<usize>) -> Result<Self, ThreadPoolBuildError> {
        let pool = match count {
            Some(1) => OnceLock::new(),
            // rayon takes 0 for "one per core".
            _ => start(count.unwrap_or(0))?.into(),
        };
        let count = pool.get().map_or(1, ThreadPool::current_num_threads);
        Ok(Self { pool: Arc::new(pool), count })
    }

    /// The caller's thread.
    pub(crate) fn one() -> Self {
        Self { pool: Arc::default(), count: 1 }
    }

    /// With one thread nothing is divided, and all work stays on the caller's thread.
    pub(crate) fn is_one(&self) -> bool {
        self.count == 1
    }

    /// Does `work` on the threads, so that what it divides is divided among them. Where the system has no thread left for
    /// a single one, it is divided among rayon's global threads.
    pub(crate) fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        if self.pool.get().is_none()
            && let Ok(pool) = start(self.count)
        {
            // Another thread may have been first: its pool serves as well.
            _ = self.pool.set(pool);
        }
        match self.pool.get() {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

fn start(count: usize) -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new().num_threads(count).thread_name(|i| format!("swm-{i}")).build()
}

/// The learned cost of one slot in one phase.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    nanos_per_slot: f64,
}

impl Default for Pace {
    /// Takes slots for expensive until it knows better.
    fn default() -> Self {
        Self { nanos_per_slot: WORTH_NANOS }
    }
}

impl Pace {
    /// Does `work` on `slots` slots, divided into parts of at most the given number of slots, and learns from how long
    /// it took. Work that is not divided stays on the caller's thread.
    pub(crate) fn learn<R: Send>(
        &mut self,
        slots: usize,
        threads: &Threads,
        work: impl FnOnce(usize) -> R + Send,
    ) -> R {
        if slots <= 1 || threads.is_one() {
            return work(slots);
        }
        let part = self.part_of(slots);
        // The hand-over is no cost of a slot: the clock starts behind it.
        let timed = || {
            let started = Instant::now();
            (work(part), started.elapsed())
        };
        let (result, elapsed) = if part == slots { timed() } else { threads.install(timed) };
        self.note(slots, part, threads.count, elapsed);
        result
    }

    /// How many slots stay together: all of them, unless each half is worth handing over.
    fn part_of(&self, slots: usize) -> usize {
        let worth = (WORTH_NANOS / self.nanos_per_slot).ceil() as usize;
        if slots < worth.saturating_mul(2) { slots } else { worth.max(1) }
    }

    fn note(&mut self, slots: usize, part: usize, threads: usize, elapsed: Duration) {
        let busy = threads.min(slots.div_ceil(part));
        let nanos = elapsed.as_nanos() as f64 * busy as f64 / slots as f64;
        // One step during which another program had the core says little about the next.
        let nanos = nanos.clamp(1.0, MOST_GROWTH * self.nanos_per_slot);
        self.nanos_per_slot += LEARNING * (nanos - self.nanos_per_slot);
    }
}

/// What a mutex holds. A panic of another holder, which poisons it, ends the run by itself.
pub(crate) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::thread::{self, ThreadId};

    use super::*;

    fn part(pace: &mut Pace, threads: &Threads, pause: Duration) -> (usize, ThreadId) {
        pace.learn(8, threads, |part| {
            thread::sleep(pause);
            (part, thread::current().id())
        })
    }

    #[test]
    fn cheap_slots_stay_together_on_the_callers_thread_and_expensive_ones_part() {
        let (threads, mut pace) = (Threads::new(Some(2)).unwrap(), Pace::default());
        let here = thread::current().id();
        (0..100).for_each(|_| _ = part(&mut pace, &threads, Duration::ZERO));
        assert_eq!(part(&mut pace, &threads, Duration::ZERO), (8, here));
        (0..40).for_each(|_| _ = part(&mut pace, &threads, Duration::from_millis(1)));
        let (part, there) = part(&mut pace, &threads, Duration::ZERO);
        assert!(part == 1 && there != here);
    }

    #[test]
    fn work_is_divided_where_each_half_is_worth_it() {
        let part = |nanos_per_slot| Pace { nanos_per_slot }.part_of(8);
        assert_eq!([1e6, 15e3, 8e3, 3.8e3, 3.7e3, 3e3, 100.0, 1.0].map(part), [1, 1, 2, 4, 8, 8, 8, 8]);
    }

    #[test]
    fn one_pause_changes_little_and_lasting_cost_is_learned() {
        let mut pace = Pace { nanos_per_slot: 2e3 };
        pace.note(8, 8, 2, Duration::from_millis(10));
        assert_eq!(pace.part_of(8), 8);
        (0..30).for_each(|_| pace.note(8, 8, 2, Duration::from_millis(10)));
        assert_eq!(pace.part_of(8), 1);
    }

    #[test]
    fn one_thread_is_the_callers() {
        let (threads, mut pace) = (Threads::new(Some(1)).unwrap(), Pace::default());
        assert_eq!(part(&mut pace, &threads, Duration::ZERO), (8, thread::current().id()));
        assert!(threads.pool.get().is_none(), "no thread was started");
        let (number, there) = threads.install(|| (rayon::current_num_threads(), thread::current().id()));
        assert!(number == 1 && there != thread::current().id());
    }
}
