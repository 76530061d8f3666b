//! The crates as a registry gets them: what each manifest must say, and a workspace of nothing but their packaged files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::read::GzDecoder;
use toml::{Table, Value};

use crate::metadata::{Metadata, Package};
use crate::process;

/// The crates that are published.
pub(super) fn published(metadata: &Metadata) -> Vec<&Package> {
    metadata.members().filter(|package| package.is_published()).collect()
}

/// What a crate's manifest lacks to be found and understood on a registry; cargo checks the rest.
pub(super) fn faults(package: &Package) -> Vec<String> {
    let has = |text: &Option<String>| text.as_deref().is_some_and(|text| !text.trim().is_empty());
    let checks = [
        (has(&package.description), "no `description`"),
        (has(&package.license), "no `license`"),
        (has(&package.repository), "no `repository`"),
        (has(&package.rust_version), "no `rust-version`"),
        (package.readme.is_some(), "no README.md"),
        ((1..=5).contains(&package.keywords.len()), "no `keywords`, or more than five"),
        ((1..=5).contains(&package.categories.len()), "no `categories`, or more than five"),
    ];
    let missing = checks.into_iter().filter(|(is_there, _)| !is_there);
    missing.map(|(_, what)| format!("{} has {what}", package.name)).collect()
}

/// Files that every package holds.
const WANTED: &[&str] = &["Cargo.toml", "LICENSE-APACHE", "LICENSE-MIT", "README.md", "src/lib.rs"];

/// The workspace of packaged crates, always at the same place, so that a second build is incremental.
pub(super) struct Packaged {
    folder: PathBuf,
    target: PathBuf,
}

impl Packaged {
    /// Packages the crates and unpacks them. A dry run takes files that are not committed, too.
    pub(super) fn make(metadata: &Metadata, is_dry: bool) -> Result<Self> {
        let mut command = process::cargo(["package", "--quiet", "--no-verify", "--locked", "--offline"]);
        let crates = published(metadata);
        command.args(is_dry.then_some("--allow-dirty"));
        process::run(command.args(crates.iter().flat_map(|package| ["--package", &package.name])))?;
        let target = metadata.target_directory.clone();
        let folder = target.join("packaged");
        fs::create_dir_all(&folder)?;
        let mut names = Vec::new();
        for package in crates {
            let name = format!("{}-{}", package.name, package.version);
            let file = target.join("package").join(format!("{name}.crate"));
            unpack(&file, &folder, &name).with_context(|| format!("failed to unpack {name}"))?;
            let missing = WANTED.iter().find(|file| !folder.join(&name).join(file).is_file());
            ensure!(missing.is_none(), "the package {name} lacks {}", missing.unwrap_or(&""));
            names.push((package.name.as_str(), name));
        }
        let ours = fs::read_to_string(process::root().join("Cargo.toml")).context("no Cargo.toml")?;
        fs::write(folder.join("Cargo.toml"), manifest(&ours, &names)?)?;
        fs::copy(process::root().join("Cargo.lock"), folder.join("Cargo.lock")).context("no Cargo.lock")?;
        Ok(Self { folder, target })
    }

    /// Runs cargo there, with the workspace's settings and build directory.
    pub(super) fn cargo(&self, args: &[&str]) -> Command {
        let mut command = process::cargo(args);
        command.current_dir(&self.folder).arg("--config").arg(process::root().join(".cargo/config.toml"));
        command.env("CARGO_TARGET_DIR", &self.target);
        command
    }
}

/// The manifest above the packaged crates (name and folder of each), with the profiles of ours: they take each other instead
/// of what a registry has.
fn manifest(ours: &str, crates: &[(&str, String)]) -> Result<String> {
    let ours: Table = ours.parse().context("failed to read Cargo.toml")?;
    let folders: Vec<Value> = crates.iter().map(|(_, folder)| folder.as_str().into()).collect();
    let workspace =
        Table::from_iter([("resolver".to_owned(), "3".into()), ("members".to_owned(), folders.into())]);
    let mut manifest = Table::from_iter([("workspace".to_owned(), workspace.into())]);
    manifest.insert("profile".into(), ours.get("profile").context("Cargo.toml has no profiles")?.clone());
    let path = |folder: &str| Value::from(Table::from_iter([("path".to_owned(), folder.into())]));
    let patch = crates.iter().map(|(name, folder)| ((*name).to_owned(), path(folder)));
    manifest.insert(
        "patch".into(),
        Table::from_iter([("crates-io".to_owned(), Table::from_iter(patch).into())]).into(),
    );
    Ok(toml::to_string(&manifest)?)
}

/// Unpacks a package into its folder `name` of `folder`. Cargo trusts file times: a file whose bytes did not change since the
/// last time keeps its own.
fn unpack(file: &Path, folder: &Path, name: &str) -> Result<()> {
    let (new, old) = (folder.join(name), folder.join("previous"));
    if old.exists() {
        fs::remove_dir_all(&old)?;
    }
    if new.exists() {
        fs::rename(&new, &old)?;
    }
    let mut archive = tar::Archive::new(GzDecoder::new(fs::File::open(file)?));
    archive.set_preserve_mtime(false);
    for entry in archive.entries()? {
        let mut entry = entry?;
        let path = entry.path()?.into_owned();
        ensure!(path.starts_with(name) && entry.unpack_in(folder)?, "refused: it holds `{}`", path.display());
        let (new, old) = (folder.join(&path), old.join(path.strip_prefix(name)?));
        if fs::read(&old).is_ok_and(|bytes| fs::read(&new).is_ok_and(|same| same == bytes)) {
            fs::rename(old, new)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;
    use crate::release::archives::{Entry, tar_gz};

    #[test]
    fn a_manifest_that_says_too_little_is_found() {
        let mut metadata = fixture("swm: swm-core\ntests: swm");
        metadata.packages[1].publish = Some(Vec::new());
        assert_eq!(published(&metadata).len(), 1);
        let package = &mut metadata.packages[0];
        package.repository = Some("https://example.org".into());
        package.rust_version = Some("1.89".into());
        package.keywords = vec!["k".into(); 6];
        package.categories = vec!["science".into()];
        assert_eq!(faults(package), ["swm has no README.md", "swm has no `keywords`, or more than five"]);
    }

    #[test]
    fn our_crates_can_be_published() {
        let metadata = Metadata::load().unwrap();
        let crates = published(&metadata);
        assert_eq!(crates.iter().flat_map(|package| faults(package)).collect::<Vec<_>>(), [""; 0]);
        assert!(crates.iter().any(|package| package.name == "swm"));
    }

    #[test]
    fn packaged_crates_take_each_other() {
        let text = manifest("[profile.dev]\nopt-level = 1\n", &[("swm", "swm-1.0.0".into())]).unwrap();
        let manifest: Table = text.parse().unwrap();
        assert_eq!(manifest["workspace"]["members"][0].as_str(), Some("swm-1.0.0"));
        assert_eq!(manifest["patch"]["crates-io"]["swm"]["path"].as_str(), Some("swm-1.0.0"));
        assert_eq!(manifest["profile"]["dev"]["opt-level"].as_integer(), Some(1));
    }

    #[test]
    fn files_that_did_not_change_keep_their_time_and_stale_ones_go() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.crate");
        let write = |list: &[(&str, &str)]| {
            let entries = list.iter().map(|(path, text)| Entry::text(*path, *text)).collect();
            fs::write(&file, tar_gz("a-1", entries, flate2::Compression::fast()).unwrap()).unwrap();
            unpack(&file, folder.path(), "a-1")
        };
        write(&[("src/a.rs", "a"), ("src/b.rs", "b")]).unwrap();
        let time =
            |name: &str| fs::metadata(folder.path().join("a-1").join(name)).unwrap().modified().unwrap();
        let old = time("src/a.rs");
        std::thread::sleep(std::time::Duration::from_millis(20));
        write(&[("src/a.rs", "a"), ("src/c.rs", "c")]).unwrap();
        assert_eq!(time("src/a.rs"), old);
        assert!(time("src/c.rs") > old);
        assert!(!folder.path().join("a-1/src/b.rs").exists());
        assert!(unpack(&file, folder.path(), "other-1").is_err(), "a package holds one folder");
    }
}
