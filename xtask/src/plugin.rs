//! `cargo xtask plugin`: crates as users write them, outside of the workspace: the one in `tests/plugin`, and one made from the
//! template of `swm new-env`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use crate::metadata::Metadata;
use crate::process;

/// Options of `cargo xtask plugin`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {}

/// Builds and tests both.
pub(crate) fn run(_args: &Args) -> Result<()> {
    let folder = tempfile::tempdir().context("no folder for a crate made from the template")?;
    let workspace = Workspace {
        target: Metadata::load()?.target_directory,
        config: folder.path().join("config.toml"),
        settings: settings()?,
    };
    workspace.test(&process::root().join("tests/plugin"))?;
    let made = folder.path().join("lone-point");
    generate(&process::root().join("crates/swm/templates/environment"), &made, "lone-point")?;
    workspace.test(&made)
}

/// What a crate outside of the workspace gets of it, so that what both depend on is built once.
struct Workspace {
    target: PathBuf,
    /// A file for cargo, with `settings` as its text.
    config: PathBuf,
    settings: String,
}

impl Workspace {
    /// Tests a crate, with the workspace's versions, profiles and build directory: its library alone, then the command too.
    fn test(&self, folder: &Path) -> Result<()> {
        fs::write(&self.config, &self.settings).context("no settings for cargo")?;
        fs::copy(process::root().join("Cargo.lock"), folder.join("Cargo.lock"))
            .context("no Cargo.lock to share")?;
        for features in [&[][..], &["--features", "cli"]] {
            let mut command = process::cargo(["test", "--quiet", "--config"]);
            command.arg(&self.config).args(features).current_dir(folder);
            process::run(command.env("CARGO_TARGET_DIR", &self.target))?;
        }
        Ok(())
    }
}

/// The workspace's profiles, and its crates in place of those of the registry, as a configuration of cargo.
fn settings() -> Result<String> {
    let manifest = fs::read_to_string(process::root().join("Cargo.toml")).context("no Cargo.toml")?;
    let manifest: toml::Table = manifest.parse()?;
    let crates = ["swm", "swm-core", "swm-fov"].map(|name| {
        let path = process::root().join("crates").join(name).display().to_string();
        (name.to_owned(), toml::Table::from_iter([("path".to_owned(), path.into())]).into())
    });
    let patch = toml::Table::from_iter([("crates-io".to_owned(), toml::Table::from_iter(crates).into())]);
    let profile = manifest.get("profile").cloned().context("Cargo.toml has no profiles")?;
    let settings =
        toml::Table::from_iter([("patch".to_owned(), patch.into()), ("profile".to_owned(), profile)]);
    Ok(toml::to_string(&settings)?)
}

/// What `swm new-env NAME` does with the template, without its source of our crates, which are patched in.
fn generate(template: &Path, folder: &Path, name: &str) -> Result<()> {
    for file in ["Cargo.toml.txt", "src/lib.rs", "src/main.rs", "tests/conformance.rs"] {
        let text =
            fs::read_to_string(template.join(file)).with_context(|| format!("the template lacks {file}"))?;
        let text = text.replace("{{project-name}}", name).replace("{{crate_name}}", &name.replace('-', "_"));
        let path = folder.join(file.trim_end_matches(".txt"));
        path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(&path, text))?;
    }
    Ok(())
}
