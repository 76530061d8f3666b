//! `cargo xtask endure`: the tests of kills, damage, hostile files and bounds, each many times more often than in a usual
//! run: 1,200 kills of the recorder and of the command, tens of thousands of damaged files, 100
//! episodes at every bound of every factor. Takes an hour or more.

use anyhow::Result;

use crate::{apart, process, setup};

/// Options of `cargo xtask endure`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only tests whose name contains this
    #[arg(value_name = "NAME")]
    filter: Option<String>,
}

/// The tests that the variable `SWM_ENDURE` prolongs, and those that always do all they can.
const TESTS: &[&str] =
    &["crash::", "mutations::", "hostile", "exhaustion::", "power_loss::", "damage", "factor_bounds::"];

/// Sets up, then runs them one after the other, so that the memory and the time of each are its own.
pub(crate) fn run(args: &Args) -> Result<()> {
    setup::run(&setup::Args::default())?;
    let mut command = process::cargo(["test", "--no-fail-fast", "--test", "it", "--test", "integration"]);
    command.args(apart::all_others()).args(["--features", "swm/lerobot", "--"]);
    match &args.filter {
        Some(name) => command.arg(name),
        None => command.args(TESTS),
    };
    process::run(command.args(["--test-threads=1", "--nocapture"]).env("SWM_ENDURE", "1"))
}
