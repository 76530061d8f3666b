//! The archives of the program: built from the packaged files and stripped, with manual pages, completions, licenses and a
//! bill of materials; its debug information is a file of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::Compression;

use super::archives::tar_gz;
use super::parts::Parts;
use super::{Release, packages, publish};
use crate::cargo_tree::{Build, PLATFORM};
use crate::setup::wheel::{create_folder, write};
use crate::{process, setup};

/// Features of a release beyond the default ones: all that need no GPU.
const ALL_FEATURES: &str = "baselines,lance,lerobot,onnx";

/// Features of a rehearsal: what tests have built already.
pub(super) const DEV_FEATURES: &str = "baselines,lerobot,onnx";

/// Files at the top of the archive, as they are in the checkout.
const FILES: &[&str] = &["CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT", "README.md"];

/// Completions: the shell, where it looks for them below a prefix such as `/usr/local`, and what they hold.
const COMPLETIONS: &[(&str, &str, &str)] = &[
    ("bash", "share/bash-completion/completions/swm", "_swm"),
    ("fish", "share/fish/vendor_completions.d/swm.fish", "complete -c swm"),
    ("zsh", "share/zsh/site-functions/_swm", "#compdef swm"),
];

/// Builds the program and packs it with what belongs to it; the bill of materials is a file of its own, too.
pub(super) fn archive(release: &Release) -> Result<String> {
    let note = if release.is_dev { "-dev" } else { "" };
    let name = format!("swm-{}-{PLATFORM}{note}", release.version);
    let scratch = tempfile::tempdir().context("no folder for the archive")?;
    let (folder, debug) = (scratch.path().join(&name), scratch.path().join(format!("{name}-debug")));
    let program = split(&build(release)?, &folder.join("bin"), &debug.join("bin"))?;
    let run = |args: &[&str]| process::output(Command::new(&program).args(args));
    let version = String::from_utf8(run(&["--version"])?).context("the version is no UTF-8")?;
    let is_ours = version.starts_with(&format!("swm {}", release.version));
    ensure!(is_ours, "the program reports `{}`", version.trim());

    let features = if release.is_dev { DEV_FEATURES } else { ALL_FEATURES };
    let features = features.split(',').map(str::to_owned).collect();
    let tree = Build { package: "swm".into(), default_features: true, features }.tree()?;
    let lock = fs::read_to_string(process::root().join("Cargo.lock")).context("no Cargo.lock")?;
    let parts = Parts::new(&tree, &release.metadata, &lock)?;
    let (bill, count) = parts.bill()?;
    write(&folder.join("swm.cdx.json"), &bill)?;
    write(&folder.join("THIRD-PARTY.txt"), parts.notices()?.as_bytes())?;
    process::output(Command::new(&program).arg("man").arg(folder.join("share/man/man1")))?;
    for (shell, path, _) in COMPLETIONS {
        let path = folder.join(path);
        create_folder(path.parent().unwrap_or(&folder))?;
        write(&path, &run(&["completions", shell])?)?;
    }
    for file in FILES {
        fs::copy(process::root().join(file), folder.join(file)).with_context(|| format!("no {file}"))?;
    }
    check(&folder)?;

    let level = if release.is_dev { Compression::fast() } else { Compression::best() };
    let program = release.write(&format!("{name}.tar.gz"), &tar_gz(&folder, level)?)?;
    let debug = release.write(&format!("{name}-debug.tar.gz"), &tar_gz(&debug, level)?)?;
    let bill = release.write(&format!("{name}.cdx.json"), &bill)?;
    let version = version.lines().next().unwrap_or_default();
    Ok(format!("{program}; {debug}; {bill} of {count} parts: {version}"))
}

/// The program, from the packaged files.
fn build(release: &Release) -> Result<PathBuf> {
    let target = &release.metadata.target_directory;
    if release.is_dev {
        // The step before has built it.
        return Ok(target.join("debug/swm"));
    }
    let args = ["build", "--profile", "dist", "--package", "swm", "--features", ALL_FEATURES];
    let mut command = packages::cargo(&release.metadata, &args);
    process::run(command.envs(setup::tools::protoc()).env("SWM_COMMIT", publish::git("rev-parse HEAD")?))?;
    Ok(target.join("dist/swm"))
}

/// Separates a program from its debug information: `swm`, and `swm.debug`, which debuggers and backtraces find next to it.
fn split(program: &Path, bin: &Path, debug: &Path) -> Result<PathBuf> {
    let (stripped, symbols) = (bin.join("swm"), debug.join("swm.debug"));
    let objcopy = |options: &[&str], from: &Path, to: &Path| {
        process::output(Command::new("objcopy").current_dir(debug).args(options).arg(from).arg(to)).map(drop)
    };
    create_folder(bin)?;
    create_folder(debug)?;
    objcopy(&["--only-keep-debug", "--compress-debug-sections"], program, &symbols)?;
    objcopy(&["--strip-all", "--add-gnu-debuglink=swm.debug"], program, &stripped)?;
    Ok(stripped)
}

/// Fails where a part of the archive is missing or does not name the program, or a shell cannot read its script.
fn check(folder: &Path) -> Result<()> {
    let pages = [
        ("", "share/man/man1/swm.1", "swm"),
        ("", "share/man/man1/swm-collect.1", "collect"),
        ("", "THIRD-PARTY.txt", "HDF5"),
    ];
    for (shell, path, what) in pages.iter().chain(COMPLETIONS) {
        let text = fs::read_to_string(folder.join(path)).unwrap_or_default();
        ensure!(text.contains(what), "the archive holds no {path} with `{what}` in it");
        // Where the shell is not installed, nobody can say.
        if !shell.is_empty() && Command::new(shell).arg("--version").output().is_ok() {
            let option = if *shell == "fish" { "--no-execute" } else { "-n" };
            process::output(Command::new(shell).arg(option).arg(folder.join(path)))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_archive_without_pages_or_with_broken_scripts_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = folder.path().join(path);
            create_folder(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let error = || check(folder.path()).unwrap_err().to_string();
        assert!(error().contains("share/man/man1/swm.1"), "{}", error());
        put("share/man/man1/swm.1", "swm");
        put("share/man/man1/swm-collect.1", "swm collect");
        put("THIRD-PARTY.txt", "HDF5");
        COMPLETIONS.iter().for_each(|(_, path, what)| put(path, what));
        put(COMPLETIONS[0].1, "complete -F _swm swm\n");
        check(folder.path()).unwrap();
        put(COMPLETIONS[0].1, "if _swm then\n");
        assert!(error().contains("bash -n"), "{}", error());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_stripped_program_runs_and_names_its_debug_file() {
        let folder = tempfile::tempdir().unwrap();
        let ours = std::env::current_exe().unwrap();
        let program = split(&ours, &folder.path().join("bin"), &folder.path().join("debug")).unwrap();
        let size = |path: &Path| fs::metadata(path).unwrap().len();
        assert!(size(&program) < size(&ours) && size(&folder.path().join("debug/swm.debug")) > 0);
        assert!(process::output(Command::new(&program).arg("--list")).is_ok());
        assert!(fs::read(program).unwrap().windows(9).any(|bytes| bytes == b"swm.debug"));
    }
}
