//! Objects with threads do not survive `fork`: each keeps the id of the process that made it, and refuses elsewhere.

use pyo3::prelude::*;

use crate::errors::SwmError;

/// The process in which an object was made.
#[derive(Clone, Copy)]
pub(crate) struct Process(u32);

impl Process {
    /// This process.
    pub(crate) fn current() -> Self {
        Self(std::process::id())
    }

    /// Whether this is the process in which the object was made.
    pub(crate) fn is_current(self) -> bool {
        self.0 == std::process::id()
    }

    /// An exception in a forked child, where the threads of `object` do not exist.
    pub(crate) fn check(self, object: &str) -> PyResult<()> {
        if self.is_current() {
            return Ok(());
        }
        Err(SwmError::new_err(format!(
            "{object} was made in process {} and this is a fork of it, without its threads; make a new one in this process",
            self.0
        )))
    }
}
