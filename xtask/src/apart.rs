//! Crates that are built apart: their dependencies take minutes, so that what means the whole workspace leaves them out,
//! and each has a step of its own in `cargo xtask ci`.

use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use crate::process;

/// Their names. They are no default members of the workspace either.
pub(crate) const APART: &[&str] = &["swm-baselines", "swm-data-lance"];

/// Cargo's options for the workspace without them.
pub(crate) fn all_others() -> Vec<&'static str> {
    let excluded = APART.iter().flat_map(|name| ["--exclude", name]);
    std::iter::once("--workspace").chain(excluded).collect()
}

/// Lints, tests, examples and documentation of one of them, with variables that its build or its tests need.
pub(crate) fn check(name: &str, environment: &[(&str, PathBuf)]) -> Result<()> {
    let run = |command: &mut Command| {
        process::run(command.envs(environment.iter().map(|(key, value)| (key, value))))
    };
    let package = ["--package", name];
    run(process::cargo(["clippy", "--all-targets"]).args(package).args(["--", "-D", "warnings"]))?;
    run(process::cargo(["test"]).args(package))?;
    run(process::cargo(["doc", "--no-deps"]).args(package).env("RUSTDOCFLAGS", "-D warnings"))
}
