//! The archive of the program: built from the packaged files, with manual pages, completions, licenses and a bill of what it
//! is made of.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::Compression;

use super::archives::{self, Entry};
use super::packages::Packaged;
use super::sbom::{self, Origins};
use super::{Profile, Release, notices, publish};
use crate::cargo_tree::{Build, CargoTree, PLATFORM};
use crate::{process, setup};

/// Features beyond the default ones, by profile.
pub(super) struct Features {
    dev: &'static [&'static str],
    release: &'static [&'static str],
}

/// A release has everything; a rehearsal what tests have built already.
pub(super) const FEATURES: Features =
    Features { dev: &["lerobot"], release: &["baselines", "lance", "lerobot", "onnx"] };

impl Features {
    fn of(&self, profile: Profile) -> &'static [&'static str] {
        match profile {
            Profile::Dev => self.dev,
            Profile::Release => self.release,
        }
    }

    /// Cargo's options for the whole workspace in the profile of tests.
    pub(super) fn dev_options(&self) -> [String; 2] {
        ["--features".into(), self.dev.iter().map(|name| format!("swm/{name}")).collect::<Vec<_>>().join(",")]
    }
}

/// Files at the top of the archive, as they are in the checkout.
const FILES: &[&str] = &["CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT", "README.md"];

/// Completions: the shell, and where it looks for them below a prefix such as `/usr/local`.
const COMPLETIONS: &[(&str, &str)] = &[
    ("bash", "share/bash-completion/completions/swm"),
    ("fish", "share/fish/vendor_completions.d/swm.fish"),
    ("zsh", "share/zsh/site-functions/_swm"),
];

/// Writes the bill of materials.
pub(super) fn write_bill(release: &Release) -> Result<String> {
    let bill = bill(release)?;
    let parts = bill["components"].as_array().map_or(0, Vec::len);
    let said = release.write(&format!("{}.cdx.json", release.name()), &pretty(&bill)?)?;
    Ok(format!("{said}, {parts} parts"))
}

fn bill(release: &Release) -> Result<serde_json::Value> {
    let lock = fs::read_to_string(process::root().join("Cargo.lock")).context("no Cargo.lock")?;
    sbom::bill(&tree(release)?, &Origins::new(&release.metadata, &lock)?)
}

fn pretty(bill: &serde_json::Value) -> Result<Vec<u8>> {
    Ok([serde_json::to_vec_pretty(bill)?.as_slice(), b"\n"].concat())
}

fn tree(release: &Release) -> Result<CargoTree> {
    let features = FEATURES.of(release.profile).iter().map(ToString::to_string).collect();
    Build { package: "swm".into(), default_features: true, features }.tree()
}

/// Builds the program and packs it with what belongs to it.
pub(super) fn archive(release: &Release) -> Result<String> {
    let program = build(release)?;
    let scratch = tempfile::tempdir().context("no folder for manual pages")?;
    let run = |args: &[&str]| process::output(Command::new(&program).args(args));
    let version = String::from_utf8(run(&["--version"])?).context("the version is no UTF-8")?;
    ensure!(
        version.starts_with(&format!("swm {}", release.version)),
        "the program says that it is `{}`",
        version.trim()
    );

    let mut entries = vec![Entry { is_program: true, ..Entry::file("bin/swm", &program)? }];
    let pages = scratch.path().join("man1");
    process::output(Command::new(&program).arg("man").arg(&pages))?;
    for page in fs::read_dir(&pages)? {
        let page = page?;
        let name = page.file_name().to_string_lossy().into_owned();
        entries.push(Entry::file(format!("share/man/man1/{name}"), &page.path())?);
    }
    for (shell, path) in COMPLETIONS {
        entries.push(Entry::text(*path, run(&["completions", shell])?));
    }
    for file in FILES {
        entries.push(Entry::file(*file, &process::root().join(file))?);
    }
    let lock = fs::read_to_string(process::root().join("Cargo.lock")).context("no Cargo.lock")?;
    let notices = notices::notices(&tree(release)?, &Origins::new(&release.metadata, &lock)?)?;
    entries.push(Entry::text("THIRD-PARTY.txt", notices));
    entries.push(Entry::text("swm.cdx.json", pretty(&bill(release)?)?));
    check(&entries)?;

    let level = if release.profile == Profile::Dev { Compression::fast() } else { Compression::best() };
    let tar = archives::tar(&release.name(), entries)?;
    let said = release.write(&format!("{}.tar.gz", release.name()), &archives::gzip(&tar, level)?)?;
    Ok(format!("{said}: {}", version.lines().next().unwrap_or_default()))
}

/// The program, from the packaged files.
fn build(release: &Release) -> Result<std::path::PathBuf> {
    let target = &release.metadata.target_directory;
    if release.profile == Profile::Dev {
        // The step before has built it.
        return Ok(target.join("debug/swm"));
    }
    let packaged = Packaged::make(&release.metadata, &release.version, release.is_dry)?;
    let features = FEATURES.release.join(",");
    let args = ["build", "--release", "--package", "swm", "--features", &features];
    let mut command = packaged.cargo(&release.metadata, &args);
    process::run(command.envs(setup::tools::protoc()).env("SWM_COMMIT", publish::commit("HEAD")?))?;
    Ok(target.join("release/swm"))
}

/// Fails where a part of the archive is missing or does not name the program.
fn check(entries: &[Entry]) -> Result<()> {
    let holds = |path: &str, what: &str| {
        entries.iter().any(|entry| entry.path == path && String::from_utf8_lossy(&entry.bytes).contains(what))
    };
    for (path, what) in [
        ("share/man/man1/swm.1", "swm"),
        ("share/man/man1/swm-collect.1", "collect"),
        ("share/bash-completion/completions/swm", "_swm"),
        ("share/fish/vendor_completions.d/swm.fish", "complete -c swm"),
        ("share/zsh/site-functions/_swm", "#compdef swm"),
        ("THIRD-PARTY.txt", "HDF5"),
    ] {
        ensure!(holds(path, what), "the archive holds no {path} with `{what}` in it");
    }
    for (shell, path) in COMPLETIONS {
        if let Some(entry) = entries.iter().find(|entry| entry.path == *path) {
            parses(shell, &entry.bytes)?;
        }
    }
    Ok(())
}

/// Whether a shell can read a script; where the shell is not installed, nobody can say.
fn parses(shell: &str, script: &[u8]) -> Result<()> {
    if Command::new(shell).arg("--version").output().is_err() {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("script");
    fs::write(&file, script)?;
    let option = if shell == "fish" { "--no-execute" } else { "-n" };
    process::output(Command::new(shell).arg(option).arg(&file as &Path)).map(drop)
}

impl Release {
    /// The name of the program's archive, without ending.
    fn name(&self) -> String {
        let note = if self.profile == Profile::Dev { "-dev" } else { "" };
        format!("swm-{}-{PLATFORM}{note}", self.version)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_completion_script_is_found() {
        assert!(parses("bash", b"complete -F _swm swm\n").is_ok());
        assert!(parses("bash", b"if then\n").is_err());
        assert!(parses("no-such-shell", b"if then\n").is_ok());
    }

    #[test]
    fn an_archive_without_manual_pages_is_refused() {
        let error = check(&[Entry::text("bin/swm", "elf")]).unwrap_err().to_string();
        assert!(error.contains("share/man/man1/swm.1"), "{error}");
    }
}
