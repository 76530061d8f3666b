//! The command `swm`, built next to the tests that start it.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&swm::registry())
}
