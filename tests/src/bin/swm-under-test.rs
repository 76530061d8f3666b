//! The command `swm`, built next to the tests that start it, and called so.

use std::process::ExitCode;

fn main() -> ExitCode {
    let args = std::env::args_os().skip(1);
    swm::cli::run(&swm::registry(), std::iter::once("swm".into()).chain(args))
}
