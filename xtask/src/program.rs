//! The command `swm` in a release build, for commands that record, train and evaluate with it.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result};
use serde_json::Value as Json;

use crate::{process, setup};

/// A file that was given, or one that is built with these features alone.
pub(crate) struct Program<'a> {
    pub(crate) given: Option<&'a Path>,
    pub(crate) features: &'static str,
}

impl Program<'_> {
    /// Builds it, where none was given.
    pub(crate) fn build(&self) -> Result<()> {
        if self.given.is_some() {
            return Ok(());
        }
        setup::for_build()?;
        process::run(process::cargo(["build"]).args(PACKAGE).arg(self.features))
    }

    /// Runs it with options whose values are paths, and returns what it says as JSON.
    pub(crate) fn run(&self, args: &[&str], paths: &[(&str, &Path)]) -> Result<Json> {
        let mut command = self.command(args)?;
        for (option, path) in paths {
            command.arg(option).arg(path);
        }
        Self::printed(command, args)
    }

    /// Runs it in a folder, from which relative paths count, and returns what it says as JSON.
    pub(crate) fn run_in(&self, folder: &Path, args: &[&str]) -> Result<Json> {
        let mut command = self.command(args)?;
        command.current_dir(folder);
        Self::printed(command, args)
    }

    fn command(&self, args: &[&str]) -> Result<Command> {
        let mut command = match self.given {
            Some(file) => Command::new(std::path::absolute(file)?),
            None => {
                let mut command = process::cargo(["run", "--quiet", "--manifest-path"]);
                command.arg(process::root().join("Cargo.toml")).args(PACKAGE).args([self.features, "--"]);
                command
            }
        };
        command.args(args);
        Ok(command)
    }

    fn printed(mut command: Command, args: &[&str]) -> Result<Json> {
        eprintln!("swm {}", args.join(" "));
        let printed = process::output(command.arg("--json"))?;
        serde_json::from_slice(&printed).with_context(|| format!("`swm {}` printed no JSON", args.join(" ")))
    }
}

const PACKAGE: [&str; 7] =
    ["--package", "swm", "--bin", "swm", "--release", "--no-default-features", "--features"];
