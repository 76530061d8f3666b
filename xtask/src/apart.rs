//! Crates that are built apart: their dependencies take minutes, so that what means the whole workspace leaves them out,
//! and each has a step of its own in `cargo xtask ci`.

use std::ffi::OsStr;

use anyhow::Result;

use crate::process;

/// Their names. They are no default members of the workspace either.
pub(crate) const APART: &[&str] = &["swm-baselines", "swm-data-lance"];

/// Cargo's options for the workspace without them.
pub(crate) fn all_others() -> Vec<&'static str> {
    let excluded = APART.iter().flat_map(|name| ["--exclude", name]);
    std::iter::once("--workspace").chain(excluded).collect()
}

/// Lints, tests, examples and documentation of one of them; `environment` is for the tests.
pub(crate) fn check(name: &str, environment: &[(&str, &OsStr)]) -> Result<()> {
    let package = ["--package", name];
    process::run(process::cargo(["clippy", "--all-targets"]).args(package).args(["--", "-D", "warnings"]))?;
    process::run(process::cargo(["test"]).args(package).envs(environment.iter().copied()))?;
    let mut doc = process::cargo(["doc", "--no-deps"]);
    process::run(doc.args(package).env("RUSTDOCFLAGS", "-D warnings"))
}
