//! One file with all pinned wheels for this kind of machine, to set up another one that has no network.
//!
//! It is a zip archive of wheels, unchanged: their pinned hashes are what is checked on the other side.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::wheel::{Package, Unpublished};

/// Fetches every package and writes the wheels into the file. Returns a line that says what was done.
pub(super) fn write(file: &Path, packages: &[&Package]) -> Result<String> {
    let file = std::path::absolute(file)?;
    let folder = file.parent().with_context(|| format!("{} is not a file name", file.display()))?;
    let work = tempfile::Builder::new().prefix(".bundle-").tempdir_in(folder);
    let work = work.with_context(|| format!("failed to create a folder in {}", folder.display()))?;
    let mut wheels = Vec::new();
    for package in packages {
        eprintln!("setup: fetching {package}");
        match package.fetch(work.path()) {
            Ok(wheel) => wheels.push((entry_name(package)?, wheel)),
            Err(error) if error.is::<Unpublished>() => eprintln!("setup: left out: {error}"),
            Err(error) => return Err(error),
        }
    }
    let partial = work.path().join("bundle");
    let size = pack(&partial, &wheels)
        .and_then(|size| fs::rename(&partial, &file).map(|()| size).map_err(Into::into))
        .with_context(|| format!("failed to write {}", file.display()))?;
    Ok(format!(
        "wrote {} ({} MB, {} wheels); on the other machine: `cargo xtask setup --from {}`",
        file.display(),
        size.div_ceil(1_000_000),
        wheels.len(),
        file.file_name().unwrap_or_default().display()
    ))
}

/// Equal bytes for equal wheels: no times are recorded. Wheels are compressed already.
fn pack(file: &Path, wheels: &[(String, PathBuf)]) -> Result<u64> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut archive = ZipWriter::new(File::create(file)?);
    for (name, wheel) in wheels {
        archive.start_file(name.as_str(), options)?;
        io::copy(&mut File::open(wheel)?, &mut archive)?;
    }
    let file = archive.finish()?;
    file.sync_all()?;
    Ok(file.metadata()?.len())
}

/// A file that [`write()`] wrote.
pub(super) struct Bundle {
    path: PathBuf,
}

impl Bundle {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let bundle = Self { path: path.into() };
        bundle.archive()?;
        Ok(bundle)
    }

    /// Copies the package's wheel for this machine into `folder`, and returns its path; its hash is checked.
    ///
    /// Entries are found by the name that they must have, so no name in the archive ever becomes a path.
    pub(super) fn wheel(&self, package: &Package, folder: &Path) -> Result<PathBuf> {
        let name = entry_name(package)?;
        let mut archive = self.archive()?;
        let held = archive.file_names().collect::<Vec<_>>().join(", ");
        let Ok(mut entry) = archive.by_name(&name) else {
            bail!(
                "{} holds no {name}: it was made on another kind of machine, or for another version of this project (it holds: {held})",
                self.path.display()
            );
        };
        let wheel = folder.join(&name);
        let copied = File::create(&wheel).and_then(|mut file| io::copy(&mut entry, &mut file));
        copied.with_context(|| format!("failed to copy {name} out of {}", self.path.display()))?;
        package.verify(&wheel)?;
        Ok(wheel)
    }

    fn archive(&self) -> Result<ZipArchive<io::BufReader<File>>> {
        let file =
            File::open(&self.path).with_context(|| format!("failed to open {}", self.path.display()))?;
        match ZipArchive::new(io::BufReader::new(file)) {
            // A wheel is a zip archive too: of a file that was cut short, the last whole wheel would be taken for all.
            Ok(archive)
                if archive.offset() == 0 && archive.file_names().all(|name| name.ends_with(".whl")) =>
            {
                Ok(archive)
            }
            Err(ZipError::Io(error)) => {
                Err(error).with_context(|| format!("failed to read {}", self.path.display()))
            }
            _ => bail!("{} is not a whole file of `cargo xtask setup --bundle`", self.path.display()),
        }
    }
}

/// What the wheel of a package is called in a bundle: the same on every machine that it serves.
fn entry_name(package: &Package) -> Result<String> {
    Ok(format!("{}-{}-{}.whl", package.name, package.version, package.wheel()?.tag))
}

#[cfg(test)]
mod tests {
    use super::super::wheel::{ANY, Keep, Wheel, tests::wheel_of};
    use super::super::{Source, data};
    use super::*;
    use std::io::Write as _;

    /// A package whose pinned wheel is the file.
    fn package_of(wheel: &Path) -> Package {
        let sha256 = super::super::wheel::sha256(wheel).unwrap();
        Package {
            name: "example",
            version: "1.0",
            wheels: vec![Wheel { platforms: &[ANY], tag: ANY, sha256: sha256.leak() }].leak(),
            keep: &[Keep { from: &["models/*.xml"], to: "models" }],
        }
    }

    fn bundle_of(entries: &[(&str, &Path)], file: &Path) -> Source {
        let entries: Vec<_> =
            entries.iter().map(|(name, path)| ((*name).to_owned(), path.to_path_buf())).collect();
        pack(file, &entries).unwrap();
        Source::Bundle(Bundle::open(file).unwrap())
    }

    const ENTRY: &str = "example-1.0-any.whl";

    #[test]
    fn data_are_installed_from_a_bundle_and_fixed_from_it() {
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        wheel_of(&["models/a.xml", "models/b.py"], &wheel);
        let package = package_of(&wheel);
        let source = bundle_of(&[(ENTRY, &wheel)], &home.path().join("bundle"));
        let data_folder = home.path().join("data");
        let said = data::ensure(&package, &data_folder, &source).unwrap();
        assert!(said.starts_with("example 1.0 unpacked in"), "{said}");
        let model = data_folder.join("example/1.0/models/a.xml");
        assert_eq!(fs::read_to_string(&model).unwrap(), "models/a.xml");
        assert!(!data_folder.join("example/1.0/partial").exists());
        let again = data::ensure(&package, &data_folder, &source).unwrap();
        assert!(again.starts_with("example 1.0 is in place"), "{again}");
        fs::write(&model, "altered").unwrap();
        data::ensure(&package, &data_folder, &source).unwrap();
        assert_eq!(fs::read_to_string(&model).unwrap(), "models/a.xml");
    }

    #[test]
    fn a_wheel_with_another_hash_is_refused_and_leaves_nothing() {
        let home = tempfile::tempdir().unwrap();
        let (wheel, other) = (home.path().join("a.whl"), home.path().join("b.whl"));
        wheel_of(&["models/a.xml"], &wheel);
        wheel_of(&["models/evil.xml"], &other);
        let source = bundle_of(&[(ENTRY, &other)], &home.path().join("bundle"));
        let error = data::ensure(&package_of(&wheel), &home.path().join("data"), &source).unwrap_err();
        let report = crate::process::report(&error);
        assert!(report.contains("is not the pinned wheel of example 1.0: its SHA-256 is"), "{report}");
        assert_eq!(fs::read_dir(home.path().join("data/example")).unwrap().count(), 0);
    }

    #[test]
    fn a_bundle_without_the_wheel_says_what_it_holds() {
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        wheel_of(&["models/a.xml"], &wheel);
        let source = bundle_of(&[("../example-1.0-any.whl", &wheel)], &home.path().join("bundle"));
        let error = data::ensure(&package_of(&wheel), &home.path().join("data"), &source).unwrap_err();
        let report = crate::process::report(&error);
        assert!(report.contains("holds no example-1.0-any.whl"), "{report}");
        assert!(report.contains("(it holds: ../example-1.0-any.whl)"), "{report}");
        assert!(!home.path().join("example-1.0-any.whl").exists());
    }

    #[test]
    fn files_that_are_no_bundle_are_refused_by_name() {
        let home = tempfile::tempdir().unwrap();
        let (missing, broken) = (home.path().join("missing"), home.path().join("broken"));
        File::create(&broken).unwrap().write_all(b"PK\x03\x04 and no end").unwrap();
        let message = |path| format!("{:#}", Bundle::open(path).map(|_| ()).unwrap_err());
        assert!(message(&missing).starts_with(&format!("failed to open {}", missing.display())));
        let said = message(&broken);
        assert!(said.contains("broken is not a whole file of `cargo xtask setup --bundle`"), "{said}");
    }

    #[test]
    fn a_bundle_that_was_cut_short_is_refused() {
        let home = tempfile::tempdir().unwrap();
        let (wheel, file) = (home.path().join("a.whl"), home.path().join("bundle"));
        wheel_of(&["models/a.xml"], &wheel);
        bundle_of(&[(ENTRY, &wheel), ("b-1.0-any.whl", &wheel)], &file);
        let bytes = fs::read(&file).unwrap();
        for length in [0, 10, bytes.len() / 2, bytes.len() - 60, bytes.len() - 1] {
            fs::write(&file, &bytes[..length]).unwrap();
            let said = format!("{:#}", Bundle::open(&file).map(|_| ()).unwrap_err());
            assert!(said.contains("bundle is not a whole file"), "{length} bytes: {said}");
        }
        fs::write(&file, fs::read(&wheel).unwrap()).unwrap();
        assert!(Bundle::open(&file).is_err(), "a wheel alone is no bundle");
    }

    #[test]
    fn equal_wheels_make_equal_bundles() {
        let home = tempfile::tempdir().unwrap();
        let wheel = home.path().join("a.whl");
        wheel_of(&["models/a.xml"], &wheel);
        let files = ["one", "two"].map(|name| home.path().join(name));
        for file in &files {
            bundle_of(&[(ENTRY, &wheel)], file);
        }
        assert_eq!(fs::read(&files[0]).unwrap(), fs::read(&files[1]).unwrap());
    }
}
