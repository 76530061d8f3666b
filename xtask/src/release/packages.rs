//! The crates as a registry gets them: which go there and in which order, what each manifest must say, and a workspace made of
//! nothing but their packaged files, to be built.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Read as _;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use flate2::read::GzDecoder;
use toml::{Table, Value};

use crate::metadata::{Metadata, Package};
use crate::process;

/// The crates that are published, each after those that it depends on.
pub(super) fn order(metadata: &Metadata) -> Result<Vec<&Package>> {
    let mut waiting: BTreeMap<&str, &Package> = metadata
        .members()
        .filter(|package| package.is_published())
        .map(|package| (package.name.as_str(), package))
        .collect();
    let mut order: Vec<&Package> = Vec::new();
    while !waiting.is_empty() {
        // A registry wants to know what tests depend on, too.
        let is_ready =
            |package: &Package| !package.dependencies.iter().any(|on| waiting.contains_key(&*on.name));
        let Some(next) = waiting.values().copied().find(|package| is_ready(package)) else {
            bail!(
                "these crates depend on each other in a circle: {}",
                waiting.into_keys().collect::<Vec<_>>().join(", ")
            );
        };
        waiting.remove(next.name.as_str());
        order.push(next);
    }
    Ok(order)
}

/// What keeps a crate from a registry, or from being found and understood there.
pub(super) fn faults(package: &Package, version: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let mut wants = |is_there: bool, what: &str| {
        if !is_there {
            faults.push(format!("{}: {what}", package.name));
        }
    };
    let has = |text: &Option<String>| text.as_deref().is_some_and(|text| !text.trim().is_empty());
    wants(package.version == version, &format!("its version is {}, not {version}", package.version));
    wants(has(&package.description), "its Cargo.toml has no `description`");
    wants(has(&package.license), "its Cargo.toml has no `license`");
    wants(has(&package.repository), "its Cargo.toml has no `repository`");
    wants(has(&package.rust_version), "its Cargo.toml has no `rust-version`");
    wants(package.readme.is_some(), "it has no README.md");
    wants((1..=5).contains(&package.keywords.len()), "its Cargo.toml has no `keywords`, or more than five");
    wants(
        (1..=5).contains(&package.categories.len()),
        "its Cargo.toml has no `categories`, or more than five",
    );
    for dependency in &package.dependencies {
        let is_pinned = dependency.path.is_none() || dependency.req.contains(version);
        wants(is_pinned, &format!("it depends on {} without its version, {version}", dependency.name));
    }
    faults
}

/// Files that every package holds.
const WANTED: &[&str] = &["Cargo.toml", "LICENSE-APACHE", "LICENSE-MIT", "README.md", "src/lib.rs"];

/// The workspace of packaged crates. Its place is always the same, and files that did not change are left alone: a second
/// build is incremental.
pub(super) struct Packaged {
    folder: PathBuf,
}

impl Packaged {
    /// Packages the crates and unpacks them. A dry run takes files that are not committed, too.
    pub(super) fn make(metadata: &Metadata, version: &str, is_dry: bool) -> Result<Self> {
        let mut command = process::cargo(["package", "--quiet", "--no-verify", "--locked", "--offline"]);
        if is_dry {
            command.arg("--allow-dirty");
        }
        let order = order(metadata)?;
        for package in &order {
            command.args(["--package", &package.name]);
        }
        process::run(&mut command)?;
        let folder = metadata.target_directory.join("packaged");
        for package in &order {
            let file = format!("{}-{version}.crate", package.name);
            let files = unpack(&metadata.target_directory.join("package").join(&file))
                .with_context(|| format!("cannot read {file}"))?;
            let missing: Vec<&str> =
                WANTED.iter().copied().filter(|name| !files.contains_key(Path::new(name))).collect();
            ensure!(missing.is_empty(), "the package of {} lacks {}", package.name, missing.join(", "));
            write_all(&folder.join("crates").join(&package.name), &files)?;
        }
        write_if_changed(&folder.join("Cargo.toml"), manifest(&order)?.as_bytes())?;
        fs::copy(process::root().join("Cargo.lock"), folder.join("Cargo.lock")).context("no Cargo.lock")?;
        Ok(Self { folder })
    }

    /// Runs cargo there, with the workspace's settings and build directory.
    pub(super) fn cargo(&self, metadata: &Metadata, args: &[&str]) -> std::process::Command {
        let mut command = process::cargo(args);
        command.current_dir(&self.folder).arg("--config").arg(process::root().join(".cargo/config.toml"));
        command.env("CARGO_TARGET_DIR", &metadata.target_directory);
        command
    }
}

/// The manifest above the packaged crates: they take each other instead of what a registry has, with our profiles.
fn manifest(order: &[&Package]) -> Result<String> {
    let ours: Table = fs::read_to_string(process::root().join("Cargo.toml"))
        .context("no Cargo.toml")?
        .parse()
        .context("Cargo.toml cannot be read")?;
    let mut profiles = ours.get("profile").and_then(Value::as_table).cloned().context("no profiles")?;
    // Symbols are most of a development build; traces of panics keep the names of functions in a release.
    for (profile, strip) in [("dev", "symbols"), ("release", "debuginfo")] {
        let packages = profiles
            .get_mut(profile)
            .and_then(Value::as_table_mut)
            .map(|profile| profile.entry("package").or_insert_with(|| Table::new().into()));
        let packages = packages.and_then(Value::as_table_mut).context("no profile of packages")?;
        packages.insert("swm".into(), Table::from_iter([("strip".to_owned(), strip.into())]).into());
    }
    let patches = order.iter().map(|package| {
        let path = format!("crates/{}", package.name);
        (package.name.clone(), Table::from_iter([("path".to_owned(), path.into())]).into())
    });
    let patch = Table::from_iter([("crates-io".to_owned(), Table::from_iter(patches).into())]);
    let workspace = toml::toml! {
        resolver = "3"
        members = ["crates/*"]
    };
    let manifest = Table::from_iter([
        ("workspace".to_owned(), workspace.into()),
        ("patch".to_owned(), patch.into()),
        ("profile".to_owned(), profiles.into()),
    ]);
    Ok(toml::to_string(&manifest)?)
}

/// The files of a package, by their path below its one folder.
fn unpack(file: &Path) -> Result<BTreeMap<PathBuf, Vec<u8>>> {
    let mut archive = tar::Archive::new(GzDecoder::new(fs::File::open(file)?));
    let mut files = BTreeMap::new();
    for entry in archive.entries()? {
        let mut entry = entry?;
        let path: PathBuf = entry.path()?.components().skip(1).collect();
        ensure!(
            path.components().all(|part| matches!(part, Component::Normal(_))),
            "it holds `{}`, which leads out of it",
            path.display()
        );
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes)?;
        files.insert(path, bytes);
    }
    Ok(files)
}

/// Makes a folder hold these files and no others.
fn write_all(folder: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) -> Result<()> {
    for (path, bytes) in files {
        write_if_changed(&folder.join(path), bytes)?;
    }
    let keep: BTreeSet<PathBuf> = files.keys().map(|path| folder.join(path)).collect();
    remove_others(folder, &keep)
}

fn remove_others(folder: &Path, keep: &BTreeSet<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_others(&entry.path(), keep)?;
        } else if !keep.contains(&entry.path()) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Cargo trusts file times, so that a file gets a new one if, and only if, its bytes are new.
fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    let write = || {
        path.parent().map_or(Ok(()), fs::create_dir_all)?;
        fs::write(path, bytes)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::{Dependency, fixture};

    #[test]
    fn crates_come_after_what_they_depend_on_and_private_ones_not_at_all() {
        let mut metadata =
            fixture("swm: swm-data swm-core\nswm-data: ~swm-core png\nswm-core:\ntests: swm\n-png:");
        metadata.packages[3].publish = Some(Vec::new());
        let names: Vec<&str> =
            order(&metadata).unwrap().iter().map(|package| package.name.as_str()).collect();
        assert_eq!(names, ["swm-core", "swm-data", "swm"]);
        let circle = order(&fixture("a: b\nb: a")).unwrap_err().to_string();
        assert!(circle.ends_with("a, b"), "{circle}");
    }

    #[test]
    fn a_manifest_that_says_too_little_is_found() {
        let mut metadata = fixture("swm: swm-core");
        let package = &mut metadata.packages[0];
        package.version = "0.1.0".into();
        package.repository = Some("https://example.org".into());
        package.rust_version = Some("1.89".into());
        package.readme = Some("README.md".into());
        package.keywords = vec!["one".into()];
        package.categories = vec!["science".into()];
        package.dependencies = vec![Dependency {
            name: "swm-core".into(),
            req: "^0.1.0".into(),
            path: Some("../swm-core".into()),
        }];
        assert_eq!(faults(package, "0.1.0"), [""; 0]);
        package.dependencies[0].req = "*".into();
        package.readme = None;
        package.keywords = vec!["k".into(); 6];
        let found = faults(package, "0.1.0");
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[2].contains("without its version, 0.1.0"));
        assert_eq!(faults(package, "0.2.0").len(), 4);
    }

    #[test]
    fn our_crates_can_be_published() {
        let metadata = Metadata::load().unwrap();
        let order = order(&metadata).unwrap();
        let version = super::super::version::current().unwrap();
        let faults: Vec<String> = order.iter().flat_map(|package| faults(package, &version)).collect();
        assert_eq!(faults, [""; 0]);
        assert_eq!(order.last().unwrap().name, "swm");
    }

    #[test]
    fn files_that_did_not_change_keep_their_time_and_stale_ones_go() {
        let folder = tempfile::tempdir().unwrap();
        let files = |list: &[(&str, &str)]| {
            list.iter().map(|(path, text)| (PathBuf::from(path), text.as_bytes().to_vec())).collect()
        };
        write_all(folder.path(), &files(&[("src/a.rs", "a"), ("src/b.rs", "b")])).unwrap();
        let time = |name: &str| fs::metadata(folder.path().join(name)).unwrap().modified().unwrap();
        let old = time("src/a.rs");
        std::thread::sleep(std::time::Duration::from_millis(20));
        write_all(folder.path(), &files(&[("src/a.rs", "a"), ("src/c.rs", "c")])).unwrap();
        assert_eq!(time("src/a.rs"), old);
        assert!(time("src/c.rs") > old);
        assert!(!folder.path().join("src/b.rs").exists());
    }
}
