//! `--threads`: on how many threads a command computes.

use clap::Args;
use swm_tasks::threads::within;

use super::Failure;

/// On how many threads a command computes.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(super) struct ThreadsArg {
    /// Threads; results do not depend on it. Default: one per core.
    #[arg(id = "threads", long = "threads", value_name = "T")]
    count: Option<usize>,
}

impl ThreadsArg {
    /// The number that was asked for.
    pub(super) fn count(self) -> Option<usize> {
        self.count
    }

    /// Does `work` with so many threads for all that it divides.
    ///
    /// # Errors
    ///
    /// A number that there cannot be, or those of `work`.
    pub(super) fn within(self, work: impl FnOnce() -> Result<(), Failure> + Send) -> Result<(), Failure> {
        within(self.count, work)?
    }
}
