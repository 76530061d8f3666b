//! Several HDF5 files of one layout: a file, or those of a folder. They are opened when they are read, so that there may be more of them than
//! a process may hold open.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::dataset::Steps;
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported};
use swm_data::hdf5::Tree;

use super::array::{Array, Scratch, Shared, new_key};
use super::hdf5::{array, scalars};
use super::natural;

/// Files of a folder, at most.
const MAX_FILES: usize = 1 << 16;
/// What an open file counts among the decoded parts that a handle keeps: it keeps 64.
const OPEN_BYTES: usize = 1 << 20;

/// A file, or those of a folder whose names start so, in their order.
pub(super) fn paths(path: &Path, start: &str) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_owned()];
    }
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().take(MAX_FILES);
    let name =
        |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| {
            path.extension().is_some_and(|kind| kind == "hdf5" || kind == "h5")
                && name(path).starts_with(start)
        })
        .collect();
    paths.sort_by_cached_key(|path| natural(&name(path)));
    paths
}

/// Whether a file has these arrays, perhaps as links. Only the groups that they are in are listed: a file may have thousands.
pub(super) fn has(path: &Path, signs: &[&str]) -> bool {
    super::hdf5::open(path).is_some_and(|tree| {
        signs.iter().all(|sign| {
            let (group, name) = sign.rsplit_once('/').unwrap_or(("", sign));
            let group = format!("/{group}");
            let (Ok((_, tables)), Ok(linked)) = (tree.members(&group), tree.links(&group)) else {
                return false;
            };
            tables.iter().chain(&linked).any(|table| table == name)
        })
    })
}

/// The files, and the arrays of each.
pub(super) struct Files {
    paths: Vec<PathBuf>,
    /// By file and path of the array; a reason: it is not read.
    heads: Vec<BTreeMap<String, std::result::Result<Head, String>>>,
}

/// What an array is.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Head {
    rows: usize,
    dtype: Dtype,
    shape: Vec<usize>,
    is_u64: bool,
    is_encoded: bool,
}

impl Head {
    fn of(rows: &Shared) -> Self {
        let (dtype, shape) = (rows.dtype(), rows.shape().to_vec());
        Self { rows: rows.rows(), dtype, shape, is_u64: rows.is_u64(), is_encoded: rows.is_encoded() }
    }
}

impl Files {
    /// With `is_jpeg`, rows of bytes that are images are decoded. Each file has the arrays `signs`.
    pub(super) fn open(paths: Vec<PathBuf>, is_jpeg: bool, signs: &[&str]) -> Result<Self> {
        let heads =
            paths.iter().map(|path| heads(path, is_jpeg).at(path.display())).collect::<Result<Vec<_>>>()?;
        if heads.is_empty() {
            return Err(missing("the folder has no file"));
        }
        let files = Self { paths, heads };
        for file in 0..files.len() {
            let lacking: Vec<&str> =
                signs.iter().copied().filter(|sign| !files.heads[file].contains_key(*sign)).collect();
            if !lacking.is_empty() {
                let reason = format!("it has no `{}`", lacking.join("` and no `"));
                return Err(missing(reason).at(files.name(file)));
            }
            signs.iter().try_for_each(|sign| files.array(file, sign).map(drop))?;
        }
        Ok(files)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.paths.len()
    }

    /// A name for messages.
    pub(super) fn name(&self, file: usize) -> std::path::Display<'_> {
        self.paths[file].display()
    }

    /// Paths of the arrays of any of them.
    pub(super) fn tables(&self) -> BTreeSet<String> {
        self.heads.iter().flat_map(BTreeMap::keys).cloned().collect()
    }

    /// The array of one file.
    pub(super) fn array(&self, file: usize, table: &str) -> Result<Shared> {
        let stored = match self.heads[file].get(table) {
            Some(Ok(head)) => Ok(Stored {
                path: self.paths[file].clone(),
                table: table.to_owned(),
                head: head.clone(),
                key: new_key(),
            }),
            Some(Err(reason)) => Err(unsupported(reason.clone())),
            None => Err(missing("it is not there")),
        };
        Ok(Arc::new(stored.at(format_args!("array `{table}`")).at(self.name(file))?))
    }

    /// The arrays of all files that have it, which have so many rows each.
    pub(super) fn arrays(&self, table: &str, rows: &[usize]) -> Result<Vec<Option<Shared>>> {
        let array = |file: usize| {
            let is_there = self.heads[file].contains_key(table);
            is_there.then(|| self.array(file, table)).transpose()
        };
        let arrays = (0..self.len()).map(array).collect::<Result<Vec<_>>>()?;
        for (file, array) in arrays.iter().enumerate() {
            if let Some(found) = array.as_ref().map(|array| array.rows()).filter(|&found| found != rows[file])
            {
                let reason = format!("it has {found} rows, and the episodes of the file have {}", rows[file]);
                return Err(invalid(reason).at(format_args!("array `{table}`")).at(self.name(file)));
            }
        }
        Ok(arrays)
    }
}

fn heads(path: &Path, is_jpeg: bool) -> Result<BTreeMap<String, std::result::Result<Head, String>>> {
    let tree = opened(path)?;
    let mut heads = BTreeMap::new();
    for table in tree.tables("/")? {
        let head = match array(&tree, "/", &table, is_jpeg) {
            Ok(rows) => Ok(Head::of(&scalars(rows))),
            Err(FormatError::Unsupported(reason)) => Err(reason.to_string()),
            Err(error) => return Err(error.at(format_args!("array `{table}`"))),
        };
        heads.insert(table, head);
    }
    Ok(heads)
}

fn opened(path: &Path) -> Result<Tree> {
    Tree::open(path).map_err(|error| invalid(error.to_string()))
}

/// An array of one file.
#[derive(Debug)]
struct Stored {
    path: PathBuf,
    table: String,
    head: Head,
    key: usize,
}

impl Stored {
    fn open(&self) -> Result<Shared> {
        let rows = scalars(array(&opened(&self.path)?, "/", &self.table, self.head.is_encoded)?);
        match Head::of(&rows) == self.head {
            true => Ok(rows),
            false => Err(invalid("it is another array than when the dataset was opened")),
        }
    }
}

impl Array for Stored {
    fn dtype(&self) -> Dtype {
        self.head.dtype
    }

    fn rows(&self) -> usize {
        self.head.rows
    }

    fn shape(&self) -> &[usize] {
        &self.head.shape
    }

    fn is_u64(&self) -> bool {
        self.head.is_u64
    }

    fn is_encoded(&self) -> bool {
        self.head.is_encoded
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let make = |_: &mut Scratch| Ok((self.open()?, OPEN_BYTES));
        let read = match scratch.part((self.key, 0), make) {
            Ok(array) => array.clone().read(rows, out, scratch),
            Err(error) => Err(error),
        };
        read.at(format_args!("array `{}`", self.table)).at(self.path.display())
    }
}
