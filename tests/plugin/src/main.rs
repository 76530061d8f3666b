//! The command `ice-rink`: everything that `swm` can do, with this crate's environment, solver, model and data format.

use std::process::ExitCode;

fn main() -> ExitCode {
    if let Err(error) = swm::data::format::register(&ice_rink::JSONL) {
        eprintln!("{error}");
        return ExitCode::FAILURE;
    }
    swm::cli::main(&ice_rink::registry())
}
