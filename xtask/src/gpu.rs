//! `cargo xtask gpu`: the command `swm` with CUDA, from its own workspace in `gpu/`, links on a machine without CUDA, trains on
//! the CPU, and names what is missing where it is asked for a GPU that it cannot use; and the scripts of `cargo xtask gpu-proof` run.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

use crate::metadata::Metadata;
use crate::{gpu_proof, process, setup};

/// Options of `cargo xtask gpu`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {}

/// Cargo's options for a build that is quick to make: without other parts of the command, and without what keeps compiled kernels
/// on disk, which is a quarter of all packages.
const LIGHT: &[&str] = &["--locked", "--no-default-features"];

/// Builds, tests and asks.
pub(crate) fn run(_args: &Args) -> Result<()> {
    setup::for_build()?;
    let workspace = Workspace::open()?;
    process::run(&mut workspace.cargo(["fmt", "--all", "--check"]))?;
    process::run(workspace.cargo(["build"]).args(LIGHT))?;
    process::run(workspace.cargo(["test", "--workspace"]).args(LIGHT))?;
    let program = workspace.program("debug");
    gpu_proof::rehearse(&program)?;
    println!("gpu: {}", ask(&program)?);
    Ok(())
}

/// The workspace in `gpu/`.
pub(crate) struct Workspace {
    target: PathBuf,
}

impl Workspace {
    /// Builds below the directory of the other workspace.
    pub(crate) fn open() -> Result<Self> {
        Ok(Self { target: Metadata::load()?.target_directory.join("gpu") })
    }

    /// Where it is.
    pub(crate) fn folder() -> PathBuf {
        process::root().join("gpu")
    }

    /// Cargo, which has to start there to find its settings.
    pub(crate) fn cargo<I: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = I>) -> Command {
        let mut command = process::cargo(args);
        command.current_dir(Self::folder()).env("CARGO_TARGET_DIR", &self.target);
        command
    }

    /// The command `swm` that a build leaves in this folder of the build directory.
    pub(crate) fn program(&self, profile: &str) -> PathBuf {
        self.target.join(profile).join(format!("swm{}", std::env::consts::EXE_SUFFIX))
    }
}

/// Trains one step, on the CPU and on a GPU, and returns what became of the latter.
fn ask(swm: &Path) -> Result<String> {
    let folder = tempfile::tempdir().context("no folder for a dataset")?;
    let data = folder.path().join("rooms.h5");
    let words = "collect swm/TwoRoom-v2 --policy random --episodes 4 --max-steps 40 --image-size 64x64 --out"
        .split(' ');
    process::run(Command::new(swm).args(words).arg(&data))?;
    let train = |device: &str| {
        let mut command = Command::new(swm);
        command.args("train lewm --preset small --steps 1 --batch 2 --device".split(' ')).arg(device);
        command.arg("--dataset").arg(&data).arg("--out").arg(folder.path().join(device));
        command
    };
    process::run(&mut train("cpu"))?;
    let asked = train("cuda").output().with_context(|| format!("cannot start {}", swm.display()))?;
    verdict(asked.status.success(), &String::from_utf8_lossy(&asked.stderr))
}

/// Whether a training on a GPU ended as it should: with success, or with an error about the device that is no panic.
fn verdict(success: bool, said: &str) -> Result<String> {
    let said = said.trim();
    if success {
        return Ok("it trains on the GPU of this machine".to_owned());
    }
    ensure!(!said.contains("panicked"), "--device cuda panics:\n{said}");
    let Some((_, reason)) = said.split_once("device `cuda:0`: ") else {
        bail!("--device cuda fails without a word about the device:\n{said}");
    };
    Ok(format!("it links, and refuses the GPU of this machine: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_about_the_device_and_no_panic() {
        assert_eq!(verdict(true, "").unwrap(), "it trains on the GPU of this machine");
        let refused = verdict(false, "error: device `cuda:0`: no driver; use cpu\n").unwrap();
        assert!(refused.ends_with("this machine: no driver; use cpu"), "{refused}");
        let other = verdict(false, "error: no such file").unwrap_err().to_string();
        assert!(other.contains("no such file"), "{other}");
        let panic = verdict(false, "thread 'main' panicked at: device `cuda:0`: x").unwrap_err().to_string();
        assert!(panic.starts_with("--device cuda panics"), "{panic}");
    }

    #[test]
    fn the_workspace_has_a_lock_file_without_what_fetches_llvm() {
        let lock = std::fs::read_to_string(Workspace::folder().join("Cargo.lock")).unwrap();
        let lock: toml::Table = lock.parse().unwrap();
        let packages = lock["package"].as_array().unwrap();
        let mut from_registry = Vec::new();
        for package in packages {
            let name = package["name"].as_str().unwrap();
            if ["cubecl-llvm", "llvm-sys", "tracel-llvm-bundler"].contains(&name) {
                from_registry.push((name, package.get("source").is_some()));
            }
        }
        assert_eq!(from_registry, [("cubecl-llvm", false)], "the crate in gpu/cubecl-llvm takes its place");
    }
}
