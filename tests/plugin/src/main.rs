//! The command `ice-rink`: everything that `swm` can do, with this crate's environment, solver, model and data format.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&ice_rink::registry())
}
