//! Crates that are built separately: their dependencies take minutes, so commands for the whole workspace leave them out, and
//! each has a step of its own in `cargo xtask ci`.

use std::path::PathBuf;

use anyhow::Result;

use crate::process;

/// Their names. They are no default members of the workspace either, nor are `swm-baselines`, `swm-checkpoints`, `swm-nn` and
/// `swm-weights`, whose tensors few need.
pub(crate) const SEPARATE: &[&str] = &["swm-data-lance"];

/// Cargo's options for the workspace without them.
pub(crate) fn all_others() -> Vec<&'static str> {
    let excluded = SEPARATE.iter().flat_map(|name| ["--exclude", name]);
    std::iter::once("--workspace").chain(excluded).collect()
}

/// Lints of one of them, with variables that its build needs.
pub(crate) fn lint(name: &str, environment: &[(&str, PathBuf)]) -> Result<()> {
    run(&["clippy", "--all-targets", "--package", name, "--", "-D", "warnings"], environment)
}

/// Its tests, examples and documentation, with variables that its build or its tests need.
pub(crate) fn test(name: &str, environment: &[(&str, PathBuf)]) -> Result<()> {
    run(&["test", "--package", name], environment)?;
    let mut doc = process::cargo(["doc", "--no-deps", "--package", name]);
    process::run(doc.envs(environment.iter().cloned()).env("RUSTDOCFLAGS", "-D warnings"))
}

fn run(args: &[&str], environment: &[(&str, PathBuf)]) -> Result<()> {
    process::run(process::cargo(args).envs(environment.iter().cloned()))
}
