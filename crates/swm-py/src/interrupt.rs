//! Ctrl-C in long native calls.
//!
//! The work runs on a thread of its own, without Python's lock. The calling thread wakes every 50 ms, lets Python handle
//! its signals, and asks the work to stop if a handler raised.

use std::panic::resume_unwind;
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use swm::core::Cancel;

/// How often a long call lets Python's signal handlers and progress bars have their turn.
pub(crate) const PERIOD: Duration = Duration::from_millis(50);

/// Runs `work` on a thread of its own, detached from Python. If a signal handler raises, `cancel` is set, and when the
/// work has ended that exception is returned. `work` looks at `cancel` itself, as the core's rollouts do.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    cancel: &Cancel,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    interruptible_with(py, cancel, || Ok(()), work)
}

/// As [`interruptible`]; `tick` is called every 50 ms and at the end, on the calling thread, to show progress. What it
/// raises stops the work, too.
pub(crate) fn interruptible_with<T: Send>(
    py: Python<'_>,
    cancel: &Cancel,
    mut tick: impl FnMut() -> PyResult<()>,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let caller = thread::current();
    thread::scope(|scope| {
        let worker = scope.spawn(move || {
            let value = work();
            caller.unpark();
            value
        });
        let mut raised = None;
        while !worker.is_finished() {
            py.detach(|| thread::park_timeout(PERIOD));
            if raised.is_none()
                && let Err(error) = py.check_signals().and_then(|()| tick())
            {
                cancel.cancel();
                raised = Some(error);
            }
        }
        let value = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
        raised.map_or(Ok(value), Err)
    })
}
