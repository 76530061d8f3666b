//! `cargo xtask gallery`: the page docs/gallery.md with an image of every environment. The work is done by the binary
//! `gallery` of the package `swm-tests`, so that xtask itself stays quick to build.

use anyhow::Result;

use crate::{process, setup};

/// Options of `cargo xtask gallery`.
#[derive(clap::Args)]
pub(crate) struct Args {}

/// Builds and runs it.
pub(crate) fn run(_args: &Args) -> Result<()> {
    setup::run(&setup::Args::default())?;
    let mut command = process::cargo(["run", "--quiet", "--package", "swm-tests", "--bin", "gallery", "--"]);
    process::run(command.arg("docs"))
}
