//! The command `swm`, built beside the tests that start it.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&swm::registry())
}
