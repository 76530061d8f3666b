//! Archives whose bytes depend on their contents alone: no times, no users, sorted names. And their checksums.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use flate2::{Compression, GzBuilder};

use crate::setup::wheel::{sha256, write};

/// A compressed tar archive of a folder and everything in it.
pub(super) fn tar_gz(folder: &Path, level: Compression) -> Result<Vec<u8>> {
    let gzip = GzBuilder::new().mtime(0).operating_system(255).write(Vec::new(), level);
    let mut builder = tar::Builder::new(gzip);
    builder.mode(tar::HeaderMode::Deterministic);
    let above = folder.parent().context("an archive holds a named folder")?;
    for file in files(folder)? {
        let name = file.strip_prefix(above)?;
        builder.append_path_with_name(&file, name).with_context(|| format!("no {}", file.display()))?;
    }
    Ok(builder.into_inner()?.finish()?)
}

/// All files below a folder, sorted.
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("failed to list {}", folder.display()))?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.sort();
    let below = paths.into_iter().map(|path| if path.is_dir() { files(&path) } else { Ok(vec![path]) });
    Ok(below.collect::<Result<Vec<_>>>()?.concat())
}

/// Writes `SHA256SUMS` for everything else in a folder, as `sha256sum --check` reads it.
pub(super) fn write_checksums(folder: &Path) -> Result<()> {
    let sums = folder.join("SHA256SUMS");
    let mut text = String::new();
    for file in files(folder)?.into_iter().filter(|file| *file != sums) {
        text += &format!("{}  {}\n", sha256(&file)?, file.strip_prefix(folder)?.display());
    }
    write(&sums, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::*;
    use crate::setup::wheel::create_folder;

    #[cfg(unix)]
    #[test]
    fn the_order_of_files_their_users_and_the_clock_do_not_show() {
        use std::os::unix::fs::PermissionsExt as _;
        let scratch = tempfile::tempdir().unwrap();
        let pack = |place: &str, time: SystemTime, mode: u32, names: [&str; 2]| {
            let folder = scratch.path().join(place).join("swm-1");
            for name in names {
                let (file, program) = (folder.join(name), if name.starts_with("bin") { 0o100 } else { 0 });
                create_folder(file.parent().unwrap()).unwrap();
                fs::write(&file, name).unwrap();
                fs::File::options().write(true).open(&file).unwrap().set_modified(time).unwrap();
                fs::set_permissions(&file, fs::Permissions::from_mode(mode | program)).unwrap();
            }
            tar_gz(&folder, Compression::fast()).unwrap()
        };
        let gz = pack("a", SystemTime::UNIX_EPOCH, 0o600, ["bin/swm", "README.md"]);
        assert_eq!(
            gz,
            pack(
                "b",
                SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000),
                0o644,
                ["README.md", "bin/swm"]
            )
        );
        assert_eq!(gz[4..8], [0; 4], "no time in the header");
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(gz.as_slice()));
        let read = archive.entries().unwrap().map(|entry| {
            let entry = entry.unwrap();
            (entry.path().unwrap().display().to_string(), entry.header().mode().unwrap())
        });
        let expected = [("README.md", 0o644), ("bin/swm", 0o755)];
        let expected = expected.map(|(name, mode)| (format!("swm-1/{name}"), mode));
        assert_eq!(read.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn checksums_name_every_other_file() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("b"), "abc").unwrap();
        fs::write(folder.path().join("a"), "").unwrap();
        for _ in 0..2 {
            write_checksums(folder.path()).unwrap();
            assert_eq!(
                fs::read_to_string(folder.path().join("SHA256SUMS")).unwrap(),
                "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855  a\n\
                 ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  b\n"
            );
        }
    }
}
