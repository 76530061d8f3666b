//! The command line of `swm`, with this crate's environment.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&swm::registry().with(&[{{crate_name}}::POINT]))
}
