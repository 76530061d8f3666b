//! The crates as a registry gets them: what each manifest must say, and a workspace of nothing but their packaged files.

use std::collections::BTreeSet;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::read::GzDecoder;
use serde_json::{Map, json};
use toml::Table;

use super::archives::files;
use crate::metadata::{Metadata, Package};
use crate::process;
use crate::setup::wheel::{create_folder, write};

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

/// Packages the crates and unpacks them into a workspace, always at the same place, so that a second build is incremental. A
/// dry run takes files that are not committed, too. Returns their number.
pub(super) fn make(metadata: &Metadata, is_dry: bool) -> Result<usize> {
    let mut command = process::cargo(["package", "--quiet", "--no-verify", "--locked", "--offline"]);
    let (crates, folder) = (published(metadata), workspace(metadata));
    command.args(is_dry.then_some("--allow-dirty"));
    process::run(command.args(crates.iter().flat_map(|package| ["--package", &package.name])))?;
    let mut names = Vec::new();
    for package in &crates {
        let name = format!("{}-{}", package.name, package.version);
        let file = metadata.target_directory.join("package").join(format!("{name}.crate"));
        unpack(&file, &folder, &name).with_context(|| format!("failed to unpack {name}"))?;
        let missing = WANTED.iter().find(|file| !folder.join(&name).join(file).is_file());
        ensure!(missing.is_none(), "the package {name} lacks {}", missing.unwrap_or(&""));
        names.push((package.name.as_str(), name));
    }
    let ours = fs::read_to_string(process::root().join("Cargo.toml")).context("no Cargo.toml")?;
    write(&folder.join("Cargo.toml"), manifest(&ours, &names)?.as_bytes())?;
    fs::copy(process::root().join("Cargo.lock"), folder.join("Cargo.lock")).context("no Cargo.lock")?;
    Ok(crates.len())
}

fn workspace(metadata: &Metadata) -> PathBuf {
    metadata.target_directory.join("packaged")
}

/// Runs cargo in the workspace of packaged crates, with the settings and the build directory of ours.
pub(super) fn cargo(metadata: &Metadata, args: &[&str]) -> Command {
    let mut command = process::cargo(args);
    command.arg("--config").arg(process::root().join(".cargo/config.toml"));
    command.current_dir(workspace(metadata)).env("CARGO_TARGET_DIR", &metadata.target_directory);
    command
}

/// The manifest above the packaged crates (name and folder of each), with the profiles of ours: they take each other instead
/// of what a registry has.
fn manifest(ours: &str, crates: &[(&str, String)]) -> Result<String> {
    let mut manifest: Table = ours.parse().context("failed to read Cargo.toml")?;
    manifest.retain(|key, _| key == "profile");
    let members: Vec<&String> = crates.iter().map(|(_, folder)| folder).collect();
    let patch: Map<_, _> =
        crates.iter().map(|(name, folder)| ((*name).to_owned(), json!({ "path": folder }))).collect();
    manifest.extend(Table::try_from(json!({
        "workspace": { "resolver": "3", "members": members },
        "patch": { "crates-io": patch },
    }))?);
    Ok(toml::to_string(&manifest)?)
}

/// Unpacks a package into its folder `name` of `folder`. Cargo trusts file times: a file whose bytes did not change since the
/// last time stays as it is.
fn unpack(file: &Path, folder: &Path, name: &str) -> Result<()> {
    create_folder(&folder.join(name))?;
    let mut stale = BTreeSet::from_iter(files(&folder.join(name))?);
    for entry in tar::Archive::new(GzDecoder::new(fs::File::open(file)?)).entries()? {
        let mut entry = entry?;
        let (path, mut bytes) = (folder.join(entry.path()?), Vec::new());
        ensure!(path.starts_with(folder.join(name)), "refused: it holds `{}`", path.display());
        entry.read_to_end(&mut bytes)?;
        if !stale.remove(&path) || fs::read(&path)? != bytes {
            create_folder(path.parent().unwrap_or(folder))?;
            write(&path, &bytes)?;
        }
    }
    stale.into_iter().try_for_each(|path| Ok(fs::remove_file(path)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;
    use crate::release::archives::tar_gz;

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
            let scratch = tempfile::tempdir().unwrap();
            let source = scratch.path().join("a-1");
            fs::create_dir_all(source.join("src")).unwrap();
            list.iter().for_each(|(path, text)| fs::write(source.join(path), text).unwrap());
            fs::write(&file, tar_gz(&source, flate2::Compression::fast()).unwrap()).unwrap();
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
