//! The archives of the program: built from the packaged files and stripped, with manual pages, completions, licenses and a
//! bill of materials; its debug information is a file of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::Compression;

use super::archives::{Entry, tar_gz};
use super::packages::Packaged;
use super::parts::Parts;
use super::{Profile, Release, publish};
use crate::cargo_tree::{Build, CargoTree, PLATFORM};
use crate::{process, setup};

/// Features of a release beyond the default ones: all that need no GPU.
const ALL_FEATURES: &str = "baselines,lance,lerobot,onnx";

/// Features of a rehearsal: what tests have built already.
pub(super) const DEV_FEATURES: &str = "lerobot";

/// Files at the top of the archive, as they are in the checkout.
const FILES: &[&str] = &["CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT", "README.md"];

/// Completions: the shell, where it looks for them below a prefix such as `/usr/local`, and what they hold.
const COMPLETIONS: &[(&str, &str, &str)] = &[
    ("bash", "share/bash-completion/completions/swm", "_swm"),
    ("fish", "share/fish/vendor_completions.d/swm.fish", "complete -c swm"),
    ("zsh", "share/zsh/site-functions/_swm", "#compdef swm"),
];

/// Writes the bill of materials.
pub(super) fn write_bill(release: &Release) -> Result<String> {
    let (tree, lock) = sources(release)?;
    let (bill, parts) = Parts::new(&tree, &release.metadata, &lock)?.bill()?;
    Ok(format!("{}, {parts} parts", release.write(&format!("{}.cdx.json", release.name()), &bill)?))
}

/// What the program depends on, and the lock file.
fn sources(release: &Release) -> Result<(CargoTree, String)> {
    let features = if release.profile == Profile::Dev { DEV_FEATURES } else { ALL_FEATURES };
    let features = features.split(',').map(str::to_owned).collect();
    let lock = fs::read_to_string(process::root().join("Cargo.lock")).context("no Cargo.lock")?;
    Ok((Build { package: "swm".into(), default_features: true, features }.tree()?, lock))
}

/// Builds the program and packs it with what belongs to it.
pub(super) fn archive(release: &Release) -> Result<String> {
    let scratch = tempfile::tempdir().context("no folder for manual pages")?;
    let (program, debug) = split(&build(release)?, scratch.path())?;
    let run = |args: &[&str]| process::output(Command::new(&program).args(args));
    let version = String::from_utf8(run(&["--version"])?).context("the version is no UTF-8")?;
    let is_ours = version.starts_with(&format!("swm {}", release.version));
    ensure!(is_ours, "the program reports `{}`", version.trim());

    let mut entries = vec![Entry { is_program: true, ..Entry::file("bin/swm", &program)? }];
    let pages = scratch.path().join("man1");
    process::output(Command::new(&program).arg("man").arg(&pages))?;
    for page in fs::read_dir(&pages)? {
        let page = page?;
        entries.push(Entry::file(format!("share/man/man1/{}", page.file_name().display()), &page.path())?);
    }
    for (shell, path, _) in COMPLETIONS {
        entries.push(Entry::text(*path, run(&["completions", shell])?));
    }
    for file in FILES {
        entries.push(Entry::file(*file, &process::root().join(file))?);
    }
    let (tree, lock) = sources(release)?;
    let parts = Parts::new(&tree, &release.metadata, &lock)?;
    entries.push(Entry::text("THIRD-PARTY.txt", parts.notices()?));
    entries.push(Entry::text("swm.cdx.json", parts.bill()?.0));
    check(&entries)?;

    let level = if release.profile == Profile::Dev { Compression::fast() } else { Compression::best() };
    let write =
        |name: &str, entries| release.write(&format!("{name}.tar.gz"), &tar_gz(name, entries, level)?);
    let said = write(&release.name(), entries)?;
    let debug = write(&format!("{}-debug", release.name()), vec![Entry::file("bin/swm.debug", &debug)?])?;
    Ok(format!("{said}; {debug}: {}", version.lines().next().unwrap_or_default()))
}

/// The program, from the packaged files.
fn build(release: &Release) -> Result<PathBuf> {
    let target = &release.metadata.target_directory;
    if release.profile == Profile::Dev {
        // The step before has built it.
        return Ok(target.join("debug/swm"));
    }
    let packaged = Packaged::make(&release.metadata, release.is_dry)?;
    let args = ["build", "--profile", "dist", "--package", "swm", "--features", ALL_FEATURES];
    let mut command = packaged.cargo(&args);
    process::run(command.envs(setup::tools::protoc()).env("SWM_COMMIT", publish::git("rev-parse HEAD")?))?;
    Ok(target.join("dist/swm"))
}

/// Separates a program from its debug information: `swm`, and `swm.debug`, which debuggers and backtraces find next to it.
fn split(program: &Path, folder: &Path) -> Result<(PathBuf, PathBuf)> {
    let (stripped, debug) = (folder.join("swm"), folder.join("swm.debug"));
    let objcopy = |options: &[&str], from: &Path, to: &Path| {
        process::output(Command::new("objcopy").current_dir(folder).args(options).arg(from).arg(to)).map(drop)
    };
    objcopy(&["--only-keep-debug", "--compress-debug-sections"], program, &debug)?;
    objcopy(&["--strip-all", "--add-gnu-debuglink=swm.debug"], program, &stripped)?;
    Ok((stripped, debug))
}

/// Fails where a part of the archive is missing or does not name the program.
fn check(entries: &[Entry]) -> Result<()> {
    let pages = [
        ("share/man/man1/swm.1", "swm"),
        ("share/man/man1/swm-collect.1", "collect"),
        ("THIRD-PARTY.txt", "HDF5"),
    ];
    for (path, what) in pages.into_iter().chain(COMPLETIONS.iter().map(|(_, path, what)| (*path, *what))) {
        let mut found = entries.iter().filter(|entry| entry.path == path);
        let holds = found.any(|entry| String::from_utf8_lossy(&entry.bytes).contains(what));
        ensure!(holds, "the archive holds no {path} with `{what}` in it");
    }
    for entry in entries {
        if let Some((shell, ..)) = COMPLETIONS.iter().find(|(_, path, _)| *path == entry.path) {
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
    process::output(Command::new(shell).arg(option).arg(file)).map(drop)
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

    #[cfg(target_os = "linux")]
    #[test]
    fn a_stripped_program_runs_and_names_its_debug_file() {
        let folder = tempfile::tempdir().unwrap();
        let ours = std::env::current_exe().unwrap();
        let (program, debug) = split(&ours, folder.path()).unwrap();
        let size = |path: &Path| fs::metadata(path).unwrap().len();
        assert!(size(&program) < size(&ours) && size(&debug) > 0);
        assert!(process::output(Command::new(&program).arg("--list")).is_ok());
        assert!(fs::read(program).unwrap().windows(9).any(|bytes| bytes == b"swm.debug"));
    }
}
