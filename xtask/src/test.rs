//! `cargo xtask test`: every test of the workspace, and the examples in its documentation.
//!
//! Benchmarks in test mode are a step of `cargo xtask nightly`.

use std::path::PathBuf;

use anyhow::Result;

use crate::metadata::Metadata;
use crate::{interop, onnx, process, separate_crates, setup};

/// Options of `cargo xtask test`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Only this crate; may be given several times
    #[arg(short, long = "package", value_name = "CRATE")]
    packages: Vec<String>,
    /// Filters and options for the test runner; with any of these, documentation examples are not run
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGS")]
    runner_args: Vec<String>,
}

/// Sets up, then runs tests and documentation examples.
pub(crate) fn run(args: &Args) -> Result<()> {
    setup::run(&setup::Args::default())?;
    suites(args)?;
    if args.runner_args.is_empty() {
        doctests(args)
    } else {
        eprintln!("test: documentation examples are not run: the extra arguments are for the test runner");
        Ok(())
    }
}

/// The tests inside of the libraries alone.
pub(crate) fn units() -> Result<()> {
    suites(&Args { packages: Vec::new(), runner_args: vec!["--lib".into()] })
}

/// Unit and integration tests, by cargo-nextest where it is installed.
pub(crate) fn suites(args: &Args) -> Result<()> {
    let mut command;
    if process::has_cargo_command("nextest") {
        command = process::cargo(["nextest", "run"]);
        if is_ci() {
            command.args(["--profile", "ci"]);
        }
    } else {
        eprintln!("test: cargo-nextest is not installed; cargo test takes its place");
        command = process::cargo(["test", "--tests", "--no-fail-fast"]);
    }
    command.env("SWM_INTEROP_PYTHON", interop::python(&interop::FORMATS)?).envs(onnx::environment()?);
    process::run(command.args(args.selection()).args(features(args)).args(&args.runner_args))
}

/// The examples in the documentation, which nextest does not run.
pub(crate) fn doctests(args: &Args) -> Result<()> {
    let metadata = Metadata::load()?;
    let has_library =
        |name: &String| metadata.members().any(|member| member.name == *name && member.has_library());
    let libraries = Args {
        packages: args.packages.iter().filter(|name| has_library(name)).cloned().collect(),
        ..Args::default()
    };
    if libraries.packages.is_empty() && !args.packages.is_empty() {
        eprintln!("test: no library among the chosen crates, so no documentation examples");
        return Ok(());
    }
    process::run(
        process::cargo(["test", "--doc", "--quiet"]).args(libraries.selection()).args(features(&libraries)),
    )
}

/// Builds what tests use, and nothing twice: the program `swm`, whose path is returned, and the Python extension.
pub(crate) fn program() -> Result<PathBuf> {
    // With tests: what they depend on decides about features, too.
    let mut build = process::cargo(["build", "--quiet", "--lib", "--bins", "--tests"]);
    process::run(build.args(whole_workspace()))?;
    Ok(Metadata::load()?.target_directory.join("debug").join(format!("swm{}", std::env::consts::EXE_SUFFIX)))
}

/// Cargo's options for the whole workspace as tests build it, so that lints and documentation share what both depend on.
pub(crate) fn whole_workspace() -> Vec<&'static str> {
    packages().into_iter().chain(features(&Args::default()).iter().copied()).collect()
}

/// The crates that can be built here, but what is built apart.
fn packages() -> Vec<&'static str> {
    let mut all = separate_crates::all_others();
    if !process::has_cxx() {
        // They have videos in MP4.
        all.extend(["--exclude", "swm-baselines", "--exclude", "swm-checkpoints", "--exclude", "swm-py"]);
    }
    all
}

/// What is not built by default and tested all the same; what is left out where no C++ compiler is at hand.
const FEATURES: &[&str] = &["--features", "swm/lerobot,swm/onnx,swm/baselines,swm-py/baselines"];

fn features(args: &Args) -> &'static [&'static str] {
    match process::has_cxx() {
        true if args.packages.is_empty() => FEATURES,
        true => &[],
        false => &["--no-default-features", "--features", "swm/cli"],
    }
}

impl Args {
    /// The crates asked for, as cargo's options.
    fn selection(&self) -> Vec<&str> {
        if self.packages.is_empty() {
            return packages();
        }
        self.packages.iter().flat_map(|name| ["--package", name]).collect()
    }
}

/// Whether a CI machine runs us, by the variable that they all set.
fn is_ci() -> bool {
    std::env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn without_options_all_is_tested_but_what_is_built_apart() {
        let args = Args::default();
        assert_eq!(args.selection()[..3], ["--workspace", "--exclude", "swm-data-lance"]);
    }

    #[test]
    fn crates_are_selected_and_the_rest_goes_to_the_runner() {
        let cli =
            Cli::parse_from(["test", "-p", "swm-core", "-p", "swm-fov", "seeds", "--no-capture", "-j1"]);
        assert_eq!(cli.args.selection(), ["--package", "swm-core", "--package", "swm-fov"]);
        assert_eq!(cli.args.runner_args, ["seeds", "--no-capture", "-j1"]);
    }

    #[test]
    fn runner_options_need_no_separator() {
        let cli = Cli::parse_from(["test", "--no-capture"]);
        assert_eq!(cli.args.runner_args, ["--no-capture"]);
    }
}
