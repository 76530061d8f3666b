//! Calls of other crates that panic on some damaged bytes: the panic becomes an error, and its message, which would look like a
//! fault of this program, is not printed.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use crate::error::{Result, invalid};

thread_local! {
    /// Whether a panic of this thread becomes an error.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Does the work on this thread.
///
/// # Errors
///
/// Those of the work, and "it cannot be decoded" where it panics.
pub fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                others(info);
            }
        }));
    });
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(work));
    GUARDED.set(outer);
    result.unwrap_or_else(|_| Err(invalid("it cannot be decoded")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_errors_and_values_pass() {
        assert_eq!(guarded(|| Ok(3)).unwrap(), 3);
        let error = guarded(|| -> Result<()> { panic!("damaged") }).unwrap_err();
        assert_eq!(error.to_string(), "it cannot be decoded");
        assert!(!GUARDED.get());
        let nested = guarded(|| {
            assert!(guarded(|| -> Result<()> { panic!("damaged") }).is_err());
            Ok(GUARDED.get())
        });
        assert!(nested.unwrap());
    }
}
