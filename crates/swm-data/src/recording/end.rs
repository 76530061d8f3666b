//! The recordings of this process that have not ended, for programs that exit without dropping their writers.

use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use super::{Backend, Recording};

/// A recording of whatever format.
pub(super) trait End: Send {
    /// As [`Recording::end`].
    fn end(&mut self);
}

impl<S: Backend> End for Recording<S> {
    fn end(&mut self) {
        Self::end(self);
    }
}

static OPEN: Mutex<Vec<Weak<Mutex<dyn End>>>> = Mutex::new(Vec::new());

/// Its value, also after a panic.
pub(super) fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on [`end_all`] ends it, too.
pub(super) fn register(recording: Weak<Mutex<dyn End>>) {
    let mut open = locked(&OPEN);
    open.retain(|recording| recording.strong_count() > 0);
    open.push(recording);
}

/// Ends all recordings of this process as dropping their writers would: a dataset that has no episode yet is removed, one that has some is
/// closed, and its lock is free. For a program that is about to exit while other threads still record: every later call of their writers
/// waits for the exit.
///
/// Returns whether all of them ended within the `limit`. The exit of the process is then like a kill to the others, which their datasets
/// survive.
pub fn end_all(limit: Duration) -> bool {
    let start = Instant::now();
    let open: Vec<Arc<Mutex<dyn End>>> = locked(&OPEN).iter().filter_map(Weak::upgrade).collect();
    let (ended, ends) = channel();
    let (all, mut count) = (open.len(), 0);
    // A writer that is busy keeps no other one from ending.
    for recording in open {
        let ended = ended.clone();
        let end = move || {
            let mut open = locked(&recording);
            open.end();
            // Unlocked, its writer would return an error whose only cause is the exit.
            std::mem::forget(open);
            let _ = ended.send(());
        };
        count += usize::from(thread::Builder::new().name("end".to_owned()).spawn(end).is_ok());
    }
    count == all && (0..count).all(|_| ends.recv_timeout(limit.saturating_sub(start.elapsed())).is_ok())
}
