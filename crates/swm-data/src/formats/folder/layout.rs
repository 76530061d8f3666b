//! What stands where in the folder. The reference's layout: `ep_len.npz` and `ep_offset.npz` say where episodes lie,
//! every other `<column>.npz` is a column, and every subfolder a column of images.
//!
//! Its readers take any other name for a column too, except those that begin with `ep_len.`; so ours are
//! `ep_len.json` (columns, kinds, metadata of runs) and `ep_len.index` (one record per episode, which says how long
//! it is and what its columns' checksums are, and commits it).

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crc32fast::hash;
use serde::{Deserialize, Serialize};
use swm_core::{Field, Metadata};
use swm_files::{is_plain_name, open_own, read_regular, write_all_at};

use crate::error::{DataError, Result};
use crate::recording::replace_json;

/// Rows of each episode, i32.
pub(super) const EP_LEN: &str = "ep_len";
/// First row of each episode, i64.
pub(super) const EP_OFFSET: &str = "ep_offset";

pub(super) const MANIFEST: &str = "ep_len.json";
pub(super) const INDEX: &str = "ep_len.index";
const INDEX_MAGIC: &[u8; 8] = b"swmidx1\n";
const VERSION: u32 = 1;
/// A manifest above this size is taken for damage.
const MAX_MANIFEST: u64 = 64 << 20;
/// A row above this size is taken for damage.
pub(super) const MAX_ROW_BYTES: usize = 1 << 30;

/// The file of a column of numbers or texts.
pub(super) fn array(folder: &Path, column: &str) -> PathBuf {
    folder.join(format!("{column}.npz"))
}

/// Whether a recording was killed here before it had begun: the index is the first file of a folder of ours, the manifest
/// the last.
pub(super) fn is_unbegun(folder: &Path) -> bool {
    index_counts_episodes(folder) == Some(false) && !folder.join(MANIFEST).exists()
}

/// Refuses a folder of ours whose manifest is gone: its index counts episodes, whose columns nothing describes.
pub(super) fn check_described(folder: &Path) -> Result<(), DataError> {
    if index_counts_episodes(folder) != Some(true) {
        return Ok(());
    }
    let reason = format!(
        "`{MANIFEST}` is missing, which describes the columns and how they were recorded, as after an incomplete copy; copy that file \
         again. Without `{INDEX}`, too, the folder is read as one of another program"
    );
    Err(DataError::damaged(folder, reason))
}

/// Whether the index goes on after its head; `None`: there is none.
fn index_counts_episodes(folder: &Path) -> Option<bool> {
    let there = fs::metadata(folder.join(INDEX)).ok()?;
    there.is_file().then_some(there.len() > INDEX_MAGIC.len() as u64)
}

/// The error for a file or subfolder without which a folder cannot be read; `holds` says what is in it.
pub(super) fn lost(folder: &Path, name: &str, holds: &str) -> DataError {
    let reason = format!(
        "`{name}` is missing, which holds {holds}, as after an incomplete copy; no repair brings it back: copy it again from where the \
         folder came"
    );
    DataError::damaged(folder, reason)
}

/// The description of a folder of ours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    version: u32,
    pub(super) format: String,
    /// All columns, in order.
    pub(super) columns: Vec<Field>,
    /// Metadata of each run, with the first episode that it recorded; in that order.
    pub(super) runs: Vec<(u64, Metadata)>,
}

impl Manifest {
    pub(super) fn new(format: &str, columns: Vec<Field>) -> Self {
        Self { version: VERSION, format: format.to_owned(), columns, runs: Vec::new() }
    }

    /// Reads it; `None` in folders of other programs. Names that would leave the folder are refused.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, DataError> {
        let path = folder.join(MANIFEST);
        let bytes = match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Ok(metadata) if metadata.len() > MAX_MANIFEST => {
                return Err(DataError::damaged(&path, format!("it has {} bytes", metadata.len())));
            }
            _ => read_regular(&path).map_err(|source| DataError::io(&path, "read", source))?,
        };
        let manifest: Self =
            serde_json::from_slice(&bytes).map_err(|error| DataError::damaged(&path, error))?;
        if manifest.version != VERSION {
            let reason = format!("its version is {}, this program knows {VERSION}", manifest.version);
            return Err(DataError::damaged(&path, reason));
        }
        for Field { name, shape, .. } in &manifest.columns {
            if !is_plain_name(name) {
                let reason = format!("column `{name}` would lie outside the folder");
                return Err(DataError::damaged(&path, reason));
            }
            let values = shape.iter().try_fold(8usize, |bytes, &size| bytes.checked_mul(size));
            if values.is_none_or(|bytes| bytes == 0 || bytes > MAX_ROW_BYTES) {
                let reason = format!("a row of column `{name}` has the shape {shape:?}");
                return Err(DataError::damaged(&path, reason));
            }
        }
        Ok(Some(manifest))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), DataError> {
        replace_json(&folder.join(MANIFEST), self)
    }
}

/// One episode in the index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) rows: u32,
    /// Of each column, in the order of the manifest: CRC-32 of the values or of the image files, end to end.
    pub(super) checksums: Vec<u32>,
}

impl Entry {
    fn size(columns: usize) -> usize {
        4 * (columns + 2)
    }

    fn to_bytes(&self) -> Vec<u8> {
        let words = std::iter::once(&self.rows).chain(&self.checksums);
        let mut bytes: Vec<u8> = words.flat_map(|word| word.to_le_bytes()).collect();
        bytes.extend(hash(&bytes).to_le_bytes());
        bytes
    }

    /// `None` for a record that was not written to its end.
    fn of(bytes: &[u8]) -> Option<Self> {
        let (content, checksum) = bytes.split_last_chunk::<4>()?;
        if hash(content) != u32::from_le_bytes(*checksum) {
            return None;
        }
        let (&rows, checksums) = content.as_chunks::<4>().0.split_first()?;
        let checksums = checksums.iter().map(|&word| u32::from_le_bytes(word)).collect();
        Some(Self { rows: u32::from_le_bytes(rows), checksums })
    }
}

/// Reads the index of a folder of ours: the episodes that were committed; `None`: there is no index.
pub(super) fn read_index(folder: &Path, columns: usize) -> Result<Option<Vec<Entry>>, DataError> {
    let path = folder.join(INDEX);
    let bytes = match read_regular(&path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        read => read.map_err(|source| DataError::io(&path, "read", source))?,
    };
    let Some(records) = bytes.strip_prefix(INDEX_MAGIC) else {
        // Killed before the first episode.
        return match bytes.len() < INDEX_MAGIC.len() {
            true => Ok(Some(Vec::new())),
            false => Err(DataError::damaged(&path, "it does not begin as an index")),
        };
    };
    let size = Entry::size(columns);
    let entries: Vec<Entry> = records.chunks(size).map_while(Entry::of).collect();
    // A kill can tear the last record only.
    if records.len() >= (entries.len() + 1) * size {
        return Err(DataError::damaged(&path, format!("the record of episode {} is damaged", entries.len())));
    }
    Ok(Some(entries))
}

/// The index of a folder that is being recorded.
#[derive(Debug)]
pub(super) struct IndexWriter {
    file: File,
    end: u64,
}

impl IndexWriter {
    /// Continues behind the first `episodes` records.
    pub(super) fn open(folder: &Path, columns: usize, episodes: usize) -> Result<Self, DataError> {
        let path = folder.join(INDEX);
        let failed = |source| DataError::io(&path, "write", source);
        let file = open_own(&path, true).map_err(failed)?;
        write_all_at(&file, INDEX_MAGIC, 0).map_err(failed)?;
        let end = (INDEX_MAGIC.len() + episodes * Entry::size(columns)) as u64;
        file.set_len(end).map_err(failed)?;
        Ok(Self { file, end })
    }

    /// Brings the records to the disk.
    pub(super) fn sync(&self) -> Result<()> {
        Ok(self.file.sync_all()?)
    }

    /// Commits an episode.
    pub(super) fn push(&mut self, entry: &Entry) -> Result<()> {
        let bytes = entry.to_bytes();
        write_all_at(&self.file, &bytes, self.end).inspect_err(|_| {
            // Half a record would look like damage once others follow it.
            let _ = self.file.set_len(self.end);
        })?;
        self.end += bytes.len() as u64;
        Ok(())
    }
}

/// Removes what makes the folder a dataset: our files, columns, subfolders of columns. Anything else stays.
pub(super) fn clear(folder: &Path, columns: &[String]) -> Result<(), DataError> {
    let failed = |path: &Path, source| DataError::io(path, "remove", source);
    if index_counts_episodes(folder) == Some(true) {
        // A kill before it is removed leaves a folder that is unbegun, not one that lost its manifest.
        let path = folder.join(INDEX);
        let emptied = open_own(&path, false).and_then(|file| file.set_len(INDEX_MAGIC.len() as u64));
        emptied.map_err(|source| failed(&path, source))?;
    }
    let index = [MANIFEST.to_owned(), INDEX.to_owned(), format!("{EP_LEN}.npz"), format!("{EP_OFFSET}.npz")];
    for name in index.into_iter().chain(columns.iter().map(|column| format!("{column}.npz"))) {
        let path = folder.join(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(&path, error)),
            _ => {}
        }
    }
    for column in columns {
        let path = folder.join(column);
        if path.is_dir() {
            fs::remove_dir_all(&path).map_err(|source| failed(&path, source))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_record_is_no_episode_and_a_damaged_one_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let mut index = IndexWriter::open(folder.path(), 2, 0).unwrap();
        let entry = |rows| Entry { rows, checksums: vec![rows + 1, rows + 2] };
        for rows in [5, 6, 7] {
            index.push(&entry(rows)).unwrap();
        }
        let read = || read_index(folder.path(), 2).map(|entries| entries.expect("there is an index"));
        assert_eq!(read().unwrap(), [5, 6, 7].map(entry));
        let path = folder.path().join(INDEX);
        let bytes = fs::read(&path).unwrap();
        for cut in 0..bytes.len() {
            fs::write(&path, &bytes[..cut]).unwrap();
            assert_eq!(read().unwrap().len(), cut.saturating_sub(8) / 16);
        }
        for at in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[at] ^= 1;
            fs::write(&path, &bytes).unwrap();
            assert!(read().is_err(), "{at}");
        }
        fs::remove_file(&path).unwrap();
        assert_eq!(read_index(folder.path(), 2).unwrap(), None);
    }

    #[test]
    fn columns_that_leave_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = |name: &str, shape: &[usize]| {
            let field = Field::step(name, swm_core::Dtype::F64, shape);
            Manifest::new("folder", vec![field]).write(folder.path()).unwrap();
            Manifest::read(folder.path())
        };
        assert_eq!(manifest("state", &[2]).unwrap().unwrap().columns.len(), 1);
        for name in ["../state", "/etc/state", "a/../../b", ".."] {
            assert!(manifest(name, &[2]).unwrap_err().to_string().contains("outside the folder"), "{name}");
        }
        for shape in [&[usize::MAX, 2][..], &[0], &[1 << 40]] {
            assert!(manifest("state", shape).is_err());
        }
    }
}
