//! `cargo xtask plugin`: crates as users write them, outside of the workspace: the one in `tests/plugin`, and one that
//! `swm new-env` makes outside of the checkout.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::metadata::Metadata;
use crate::{process, test};

/// Options of `cargo xtask plugin`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {}

/// Builds and tests both.
pub(crate) fn run(_args: &Args) -> Result<()> {
    let folder = tempfile::tempdir().context("no folder for a crate made from the template")?;
    let workspace = Workspace {
        metadata: Metadata::load()?,
        config: folder.path().join("config.toml"),
        manifest: manifest()?,
    };
    workspace.test(&process::root().join("tests/plugin"), &["patch", "profile"])?;
    // Elsewhere, as a user does it: what the command writes has to find the crates and the build tools by itself.
    let made = folder.path().join("lone-point");
    workspace.make("lone-point", &made)?;
    workspace.test(&made, &["profile"])
}

/// What a crate outside of the workspace gets of it, so that what both depend on is built once.
struct Workspace {
    metadata: Metadata,
    /// A file for cargo.
    config: PathBuf,
    /// What may stand in it: the workspace's profiles, and its crates in place of those of the registry.
    manifest: toml::Table,
}

impl Workspace {
    /// `swm new-env`, from the program that the tests build.
    fn make(&self, name: &str, folder: &Path) -> Result<()> {
        let mut command = Command::new(test::program()?);
        command.args(["new-env", name, "--out"]).arg(folder).arg("--checkout").arg(process::root());
        process::run(&mut command)
    }

    /// Tests a crate, with the workspace's versions and build directory: its library alone, then the command too. `shared`:
    /// what else it gets of the workspace.
    fn test(&self, folder: &Path, shared: &[&str]) -> Result<()> {
        let mut settings = self.manifest.clone();
        settings.retain(|key, _| shared.contains(&key));
        fs::write(&self.config, toml::to_string(&settings)?).context("no settings for cargo")?;
        fs::copy(process::root().join("Cargo.lock"), folder.join("Cargo.lock"))
            .context("no Cargo.lock to share")?;
        for features in [&[][..], &["--features", "cli"]] {
            let mut command = process::cargo(["test", "--quiet", "--config"]);
            command.arg(&self.config).args(features).current_dir(folder);
            process::run(command.env("CARGO_TARGET_DIR", &self.metadata.target_directory))?;
        }
        Ok(())
    }
}

/// The manifest of the workspace, with its crates in place of those of the registry.
fn manifest() -> Result<toml::Table> {
    let manifest = fs::read_to_string(process::root().join("Cargo.toml")).context("no Cargo.toml")?;
    let mut manifest: toml::Table = manifest.parse()?;
    let crates = ["swm", "swm-core", "swm-fov"].map(|name| {
        let path = process::root().join("crates").join(name).display().to_string();
        (name.to_owned(), toml::Table::from_iter([("path".to_owned(), path.into())]).into())
    });
    let patch = toml::Table::from_iter([("crates-io".to_owned(), toml::Table::from_iter(crates).into())]);
    manifest.insert("patch".to_owned(), patch.into());
    Ok(manifest)
}
