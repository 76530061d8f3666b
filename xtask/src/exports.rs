//! `cargo xtask exports`: what `swm export` writes is loaded by the reference's own `load_pretrained`, with equal outputs.
//!
//! The reference comes with torch, gigabytes of it, in a virtual environment of its own.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::metadata::Metadata;
use crate::{interop, process};

/// Options of `cargo xtask exports`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// A Python that has the reference, in place of a virtual environment in .tools/reference
    #[arg(long, value_name = "PYTHON")]
    python: Option<PathBuf>,
    /// A command `swm` with the feature baselines, in place of the one that is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

/// Imports the golden checkpoints, exports them, and compares what the reference makes of that.
pub(crate) fn run(args: &Args) -> Result<()> {
    let python = args.python.clone().map_or_else(|| interop::python(&interop::REFERENCE), Ok)?;
    let swm = args.swm.clone().map_or_else(build, Ok)?;
    let work = process::root().join(".tools/exports");
    if work.exists() {
        fs::remove_dir_all(&work).with_context(|| format!("cannot remove {}", work.display()))?;
    }
    let mut script = Command::new(python);
    script.current_dir(process::root()).args(["-W", "ignore", "tests/interop/load_exports.py"]);
    process::run(script.arg(swm).arg("tests/golden/checkpoints").arg(work))
}

fn build() -> Result<PathBuf> {
    process::run(&mut process::cargo(["build", "--package", "swm", "--features", "baselines,onnx"]))?;
    Ok(Metadata::load()?.target_directory.join("debug/swm"))
}
