//! The standard output and the standard error: what happens where nobody reads them, or their disk is full.

use std::io::Write as _;

use super::{Failure, program_name};

/// Prints help, the version or what is wrong in a command line, each where clap says.
pub(super) fn print_of_clap(error: &clap::Error) {
    // Clap's own way has styles.
    if !program_name::is_renamed() {
        let _ = error.print();
        return;
    }
    let text = error.render().to_string();
    match error.use_stderr() {
        true => print_to_stderr(&program_name::with_name(&text)),
        // A reader that is gone has no wish.
        false => drop(print(&program_name::with_name(&text))),
    }
}

/// Prints to stdout. A reader that has what it wants (`head`, say) is no failure.
pub(super) fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{}", text.trim_end()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        result => Ok(result.map_err(|error| format!("cannot write to the standard output: {error}"))?),
    }
}

/// Prints to stderr, in one write: it has no buffer, and processes beside this one cannot cut the text. Where its reader is gone or
/// its disk full, the text is lost and the work goes on, as in `2>&1 | head -1`; the macros of the standard library would panic.
pub(super) fn print_to_stderr(text: &str) {
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
