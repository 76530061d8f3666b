//! `cargo xtask golden --check [DIR]`: replay trajectories of the reference. The work is done by the binary `golden`
//! of the package `swm-tests`, so that xtask itself stays quick to build.

use std::ffi::OsString;

use anyhow::Result;

use crate::{process, setup};

/// Options of `cargo xtask golden`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Replay and compare; exit status 1 above the stated tolerances
    #[arg(long, required = true)]
    check: bool,
    /// Folder of `.npz` files, searched recursively; default: the committed ones
    dir: Option<OsString>,
}

/// Builds and runs the check.
pub(crate) fn run(args: &Args) -> Result<()> {
    debug_assert!(args.check, "the only mode");
    setup::run(&setup::Args::default())?;
    let dir = args.dir.as_ref().map(std::path::absolute).transpose()?;
    let mut command =
        process::cargo(["run", "--quiet", "--package", "swm-tests", "--bin", "golden", "--", "--check"]);
    process::run(command.args(dir))
}
