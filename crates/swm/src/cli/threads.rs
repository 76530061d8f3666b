//! `--threads`: on how many threads a command computes.

use clap::{ArgMatches, Args};

/// On how many threads a command computes. [`of`] reads it for all that the command divides.
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
}

/// The threads that a command line gives its command. Some commands divide no work, or choose the threads themselves.
pub(super) fn of(line: &ArgMatches) -> Option<usize> {
    let (_, command) = line.subcommand()?;
    command.try_get_one("threads").ok().flatten().copied()
}
