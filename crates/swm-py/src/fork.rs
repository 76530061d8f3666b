//! Objects with threads do not survive `fork`: each keeps the process that made it, and refuses elsewhere.

use std::sync::atomic::{AtomicU32, Ordering};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::SwmError;

/// How many forks lie between the process that loaded the module and this one. Python counts them, because asking the
/// system for the process at every step would take longer than the rest of the call.
static FORKS: AtomicU32 = AtomicU32::new(0);

/// The process in which an object was made.
#[derive(Clone, Copy)]
pub(crate) struct Process {
    forks: u32,
    id: u32,
}

impl Process {
    /// This process.
    pub(crate) fn current() -> Self {
        Self { forks: FORKS.load(Ordering::Relaxed), id: std::process::id() }
    }

    /// Whether this is the process in which the object was made.
    pub(crate) fn is_current(self) -> bool {
        self.forks == FORKS.load(Ordering::Relaxed)
    }

    /// An exception in a forked child, where the threads of `object` do not exist.
    pub(crate) fn check(self, object: &str) -> PyResult<()> {
        if self.is_current() {
            return Ok(());
        }
        Err(SwmError::new_err(format!(
            "{object} was made in process {} and this is a fork of it, without its threads; make a new one in this process",
            self.id
        )))
    }
}

/// Called by Python in every forked child.
#[pyfunction]
fn _forked() {
    FORKS.fetch_add(1, Ordering::Relaxed);
}

/// Asks Python to count forks.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    let os = py.import("os")?;
    if os.hasattr("register_at_fork")? {
        let hook = PyDict::new(py);
        hook.set_item("after_in_child", wrap_pyfunction!(_forked, m)?)?;
        os.call_method("register_at_fork", (), Some(&hook))?;
    }
    Ok(())
}
