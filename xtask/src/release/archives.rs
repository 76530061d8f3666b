//! Archives whose bytes depend on their contents alone: no times, no users, sorted names. And their checksums.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use flate2::{Compression, GzBuilder};

use crate::setup::wheel::sha256;

/// A file of an archive.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry {
    /// Below the archive's one folder.
    pub path: String,
    pub bytes: Vec<u8>,
    pub is_program: bool,
}

impl Entry {
    pub(super) fn text(path: impl Into<String>, text: impl Into<Vec<u8>>) -> Self {
        Self { path: path.into(), bytes: text.into(), is_program: false }
    }

    /// Of a file.
    pub(super) fn file(path: impl Into<String>, file: &Path) -> Result<Self> {
        let bytes = fs::read(file).with_context(|| format!("failed to read {}", file.display()))?;
        Ok(Self::text(path, bytes))
    }
}

/// A compressed tar archive of files in the folder `root`.
pub(super) fn tar_gz(root: &str, mut entries: Vec<Entry>, level: Compression) -> Result<Vec<u8>> {
    entries.sort();
    let gzip = GzBuilder::new().mtime(0).operating_system(255).write(Vec::new(), level);
    let mut builder = tar::Builder::new(gzip);
    for entry in &entries {
        // A new header has no time, no user and no group.
        let mut header = tar::Header::new_gnu();
        header.set_size(entry.bytes.len() as u64);
        header.set_mode(if entry.is_program { 0o755 } else { 0o644 });
        builder
            .append_data(&mut header, format!("{root}/{}", entry.path), entry.bytes.as_slice())
            .with_context(|| format!("failed to archive {}", entry.path))?;
    }
    let mut gzip = builder.into_inner()?;
    gzip.flush()?;
    Ok(gzip.finish()?)
}

/// Writes `SHA256SUMS` for everything else in a folder, as `sha256sum --check` reads it.
pub(super) fn write_checksums(folder: &Path) -> Result<()> {
    const NAME: &str = "SHA256SUMS";
    let mut lines = Vec::new();
    for file in fs::read_dir(folder).with_context(|| format!("failed to list {}", folder.display()))? {
        let (path, name) = file.map(|file| (file.path(), file.file_name().to_string_lossy().into_owned()))?;
        if name != NAME && path.is_file() {
            lines.push((name, sha256(&path)?));
        }
    }
    lines.sort();
    let text: String = lines.into_iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect();
    fs::write(folder.join(NAME), text).with_context(|| format!("failed to write into {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_entries_and_the_clock_do_not_show() {
        let program = Entry { is_program: true, ..Entry::text("bin/swm", "elf") };
        let long = Entry::text(format!("share/{}", "x".repeat(150)), "long names fit");
        let mut entries = vec![program, Entry::text("README.md", "# hello"), long];
        let gz = tar_gz("swm-1", entries.clone(), Compression::fast()).unwrap();
        entries.reverse();
        assert_eq!(gz, tar_gz("swm-1", entries, Compression::fast()).unwrap());
        assert_eq!(gz[4..8], [0; 4], "no time in the header");

        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(gz.as_slice()));
        let entries = archive.entries().unwrap().map(|entry| {
            let entry = entry.unwrap();
            let (path, header) = (entry.path().unwrap().display().to_string(), entry.header());
            (path, header.mode().unwrap(), header.mtime().unwrap())
        });
        let read: Vec<(String, u32, u64)> = entries.collect();
        assert_eq!(read[0], ("swm-1/README.md".into(), 0o644, 0));
        assert_eq!(read[1], ("swm-1/bin/swm".into(), 0o755, 0));
        assert!(read[2].0.len() > 150);
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
