//! The command `swm`.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&swm::registry())
}
