//! The tables, in their folder and in memory.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use swm_lance::{Bytes, Store};

/// Every table that is read whole.
pub(crate) const TABLES: &[&str] = &[
    "altered",
    "borders_2_0",
    "borders_2_1",
    "borders_2_2",
    "large_2_0",
    "large_2_1",
    "large_2_2",
    "lists_2_0",
    "lists_2_1",
    "lists_2_2",
    "narrow_2_0",
    "narrow_2_1",
    "narrow_2_2",
    "packed_2_1",
    "packed_2_2",
    "pages_2_0",
    "pages_2_1",
    "pages_2_2",
];

/// The folder of the tables.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/lance")
}

/// Tables of which rows are deleted.
pub(crate) const DELETED: &[&str] = &["deleted", "deleted_many"];

/// A table in memory, which counts what is read of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    pub(crate) files: BTreeMap<String, Arc<[u8]>>,
    pub(crate) read: Arc<AtomicU64>,
}

impl Memory {
    pub(crate) fn of(name: &str) -> Self {
        let mut memory = Self::default();
        for part in ["_versions", "data", "_deletions"] {
            let path = folder().join(format!("{name}.lance")).join(part);
            if part == "_deletions" && !path.exists() {
                continue;
            }
            for entry in path.read_dir().unwrap_or_else(|error| panic!("{}: {error}", path.display())) {
                let path = entry.unwrap().path();
                let name = format!("{part}/{}", path.file_name().unwrap().to_string_lossy());
                memory.files.insert(name, std::fs::read(path).unwrap().into());
            }
        }
        memory
    }
}

impl Store for Memory {
    fn names(&self, folder: &str) -> io::Result<Vec<String>> {
        let names = self.files.keys().filter_map(|path| path.strip_prefix(folder)?.strip_prefix('/'));
        Ok(names.map(str::to_owned).collect())
    }

    fn open(&self, path: &str) -> io::Result<Box<dyn Bytes>> {
        let bytes = self.files.get(path).ok_or(io::ErrorKind::NotFound)?.clone();
        Ok(Box::new(Part { bytes, read: self.read.clone() }))
    }
}

#[derive(Debug)]
struct Part {
    bytes: Arc<[u8]>,
    read: Arc<AtomicU64>,
}

impl Bytes for Part {
    fn length(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        let part = usize::try_from(at).ok().and_then(|at| self.bytes.get(at..)?.get(..out.len()));
        out.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
        self.read.fetch_add(out.len() as u64, Ordering::Relaxed);
        Ok(())
    }
}
