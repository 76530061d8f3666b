//! `--threads`: on how many threads a command computes.

use clap::Args;
use rayon::ThreadPoolBuilder;

use super::{Failure, usage};

/// More in one process are a typing error.
const MAX: usize = 1024;
/// Work that a main thread can hold must fit on these threads, too.
const STACK_BYTES: usize = 8 << 20;

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
        let Some(count) = self.count else { return work() };
        if !(1..=MAX).contains(&count) {
            return Err(usage(format!(
                "--threads {count}: use 1 to {MAX} threads, or leave it out for one per core"
            )));
        }
        let pool = || ThreadPoolBuilder::new().num_threads(count).stack_size(STACK_BYTES);
        // A process that has divided no work yet gets so many threads for good, so that readers and writers on threads of their own
        // divide theirs among the same ones.
        if pool().build_global().is_ok() || rayon::current_num_threads() == count {
            return work();
        }
        match pool().build() {
            Ok(pool) => pool.install(work),
            Err(error) => Err(format!("cannot start {count} threads: {error}").into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_divided_among_so_many_threads() {
        for count in [1, 3] {
            let mut found = 0;
            let threads = ThreadsArg { count: Some(count) };
            threads
                .within(|| {
                    found = rayon::current_num_threads();
                    Ok(())
                })
                .unwrap();
            assert_eq!(found, count);
        }
        for wrong in [0, 1025] {
            let failure = ThreadsArg { count: Some(wrong) }.within(|| Ok(())).unwrap_err();
            assert_eq!(failure.exit_code(), 2);
            let message = failure.to_string();
            assert!(message.contains(&format!("--threads {wrong}: use 1 to 1024")), "{message}");
        }
    }
}
