//! On how many threads a request is run.

use rayon::ThreadPoolBuilder;

use crate::request::{Message, TaskError};

/// More in one process are a typing error.
const MAX: usize = 1024;
/// Work that a main thread can hold must fit on these threads, too.
const STACK_BYTES: usize = 8 << 20;

/// Refuses a number of threads that there cannot be.
pub(crate) fn check(count: Option<usize>) -> Result<(), TaskError> {
    let Some(count) = count.filter(|count| !(1..=MAX).contains(count)) else { return Ok(()) };
    let text = format!("use 1 to {MAX} threads, or leave it out for one per core");
    Err(Message::about("threads", count, text).into())
}

/// Does `work` with `count` threads for all that it divides; `None`: one per core.
///
/// # Errors
///
/// [`TaskError::Request`]: a number that there cannot be; [`TaskError::Failed`]: the system starts no threads.
pub fn within<T: Send>(count: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T, TaskError> {
    check(count)?;
    let Some(count) = count else { return Ok(work()) };
    let pool = || ThreadPoolBuilder::new().num_threads(count).stack_size(STACK_BYTES);
    // A process that has divided no work yet gets so many threads for good, so that readers and writers on threads of their own
    // divide theirs among the same ones.
    if pool().build_global().is_ok() || rayon::current_num_threads() == count {
        return Ok(work());
    }
    match pool().build() {
        Ok(pool) => Ok(pool.install(work)),
        Err(error) => Err(format!("cannot start {count} threads: {error}").into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_divided_among_so_many_threads() {
        for count in [1, 3] {
            assert_eq!(within(Some(count), rayon::current_num_threads).unwrap(), count);
        }
        for wrong in [0, 1025] {
            let error = within(Some(wrong), || ()).unwrap_err().to_string();
            assert!(error.contains(&format!("threads={wrong}: use 1 to 1024")), "{error}");
        }
    }
}
