//! Opening a folder for reading: ours by its manifest and index, those of other programs by what lies in them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::env::VARIATION_PREFIX;
use swm_core::{Field, FieldKind, Schema, SliceMut};

use super::images::{ImageReader, Store};
use super::layout::{self, EP_LEN, EP_OFFSET, Entry, Manifest};
use crate::dataset::{CHANGED, Dataset, DatasetInfo, Steps};
use crate::error::{DataError, FormatError, wrong_type};
use crate::formats::npz::Array;

/// An open folder.
#[derive(Debug)]
pub(super) struct FolderDataset {
    shared: Arc<Shared>,
    /// One per column; those of arrays stay empty.
    images: BTreeMap<usize, ImageReader>,
    scratch: Vec<u8>,
}

/// What all handles share; never changed after opening.
#[derive(Debug)]
struct Shared {
    info: DatasetInfo,
    store: Store,
    columns: Vec<Source>,
    /// First rows, by episode.
    first: Vec<usize>,
    manifest: Option<Manifest>,
    /// One per episode in folders of ours.
    entries: Vec<Entry>,
}

#[derive(Debug)]
enum Source {
    Array(Array),
    /// The subfolder.
    Images(PathBuf),
}

impl FolderDataset {
    pub(super) fn open(path: &Path, format: &'static str, store: Store) -> Result<Self, DataError> {
        let shared = match Manifest::read(path)? {
            Some(manifest) => Shared::ours(path, format, store, manifest)?,
            None => Shared::foreign(path, format, store)?,
        };
        Ok(Self { shared: Arc::new(shared), images: BTreeMap::new(), scratch: Vec::new() })
    }

    pub(super) fn manifest(&self) -> Option<&Manifest> {
        self.shared.manifest.as_ref()
    }
}

impl Shared {
    fn ours(path: &Path, format: &'static str, store: Store, manifest: Manifest) -> Result<Self, DataError> {
        let schema =
            Schema::new(manifest.columns.clone()).map_err(|error| DataError::damaged(path, error))?;
        let entries = layout::read_index(path, manifest.columns.len())?;
        let (mut rows, mut first, mut lengths) = (0usize, Vec::new(), Vec::new());
        for entry in &entries {
            first.push(rows);
            lengths.push(entry.rows as usize);
            rows += entry.rows as usize;
        }
        let mut columns = Vec::new();
        for field in &manifest.columns {
            if store.takes(field) {
                columns.push(Source::Images(path.join(&field.name)));
                continue;
            }
            let file = layout::array(path, &field.name);
            let damaged = |error| DataError::damaged(&file, error);
            let array = Array::open_growing(&file, rows).map_err(damaged)?;
            if array.elements().dtype() != field.dtype || array.row_shape() != field.shape {
                let (elements, shape) = (array.elements(), array.row_shape());
                return Err(damaged(wrong_type(format!(
                    "it holds {elements:?} {shape:?}, not {} {:?}",
                    field.dtype, field.shape
                ))));
            }
            columns.push(Source::Array(array));
        }
        let mut info = DatasetInfo::new(path, format, schema, lengths);
        info.runs = manifest.runs.clone().into();
        info.has_checksums = true;
        Ok(Self { info, store, columns, first, manifest: Some(manifest), entries })
    }

    fn foreign(path: &Path, format: &'static str, store: Store) -> Result<Self, DataError> {
        let (mut fields, mut columns, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
        let mut index = BTreeMap::new();
        let mut names = Vec::new();
        for entry in fs::read_dir(path).map_err(|source| DataError::io(path, "open", source))? {
            let entry = entry.map_err(|source| DataError::io(path, "open", source))?;
            names.extend(entry.file_name().to_str().map(|name| (name.to_owned(), entry.path())));
        }
        names.sort();
        let mut folders = Vec::new();
        for (name, file) in names {
            let Some(column) = name.strip_suffix(".npz") else {
                folders.extend(file.is_dir().then_some((name, file)));
                continue;
            };
            match Array::open(&file) {
                Ok(array) if [EP_LEN, EP_OFFSET].contains(&column) => {
                    let numbers = array.integers().map_err(|error| DataError::damaged(&file, error))?;
                    index.insert(column.to_owned(), numbers);
                }
                Ok(array) => {
                    let field = field(column, array.elements().dtype(), array.row_shape());
                    fields.push(field);
                    columns.push(Source::Array(array));
                }
                Err(error @ FormatError::Unsupported(_)) => {
                    skipped.push((column.to_owned(), error.to_string()));
                }
                Err(error) => return Err(DataError::damaged(&file, error)),
            }
        }
        let rows = columns.iter().zip(&fields).filter_map(|(source, field)| match source {
            Source::Array(array) => Some((field.name.as_str(), array.rows())),
            Source::Images(_) => None,
        });
        let episodes = spans(path, &index, rows.min_by_key(|&(_, rows)| rows))?;
        if !episodes.is_empty() {
            for (name, folder) in folders {
                match store.shape(&folder, 0) {
                    Ok(shape) => {
                        fields.push(field(&name, swm_core::Dtype::U8, &shape));
                        columns.push(Source::Images(folder));
                    }
                    Err(error) => skipped.push((name, error.to_string())),
                }
            }
        }
        let schema = Schema::new(fields).map_err(|error| DataError::damaged(path, error))?;
        let (first, lengths) = episodes.into_iter().unzip();
        let mut info = DatasetInfo::new(path, format, schema, lengths);
        info.skipped = skipped.into();
        Ok(Self { info, store, columns, first, manifest: None, entries: Vec::new() })
    }
}

fn field(name: &str, dtype: swm_core::Dtype, shape: &[usize]) -> Field {
    let kind = if name.starts_with(VARIATION_PREFIX) { FieldKind::Episode } else { FieldKind::Step };
    Field { name: name.to_owned(), dtype, shape: shape.to_vec(), kind }
}

/// Where episodes lie in the arrays of another program; `shortest` is the array with the fewest rows.
fn spans(
    path: &Path,
    index: &BTreeMap<String, Vec<i64>>,
    shortest: Option<(&str, usize)>,
) -> Result<Vec<(usize, usize)>, DataError> {
    let [Some(lengths), Some(offsets)] = [index.get(EP_LEN), index.get(EP_OFFSET)] else {
        let reason = format!("it has no `{EP_LEN}.npz` and `{EP_OFFSET}.npz`, which say where episodes lie");
        return Err(DataError::not_a_dataset(path, reason));
    };
    if lengths.len() != offsets.len() {
        let reason = format!("{} episodes have a length, {} an offset", lengths.len(), offsets.len());
        return Err(DataError::damaged(path, reason));
    }
    let (shortest, rows) = shortest.unwrap_or(("", usize::MAX));
    let mut spans = Vec::with_capacity(lengths.len());
    for (episode, (&len, &offset)) in lengths.iter().zip(offsets).enumerate() {
        let len_fits = usize::try_from(len).ok().filter(|_| len <= i64::from(i32::MAX));
        let span = usize::try_from(offset).ok().zip(len_fits);
        let fits = |&(first, len): &(usize, usize)| first.checked_add(len).is_some_and(|end| end <= rows);
        let Some(span) = span.filter(fits) else {
            let reason = format!(
                "episode {episode} has {len} rows from row {offset} on, but column `{shortest}` has {rows}"
            );
            return Err(DataError::damaged(path, reason));
        };
        spans.push(span);
    }
    Ok(spans)
}

impl Dataset for FolderDataset {
    fn info(&self) -> &DatasetInfo {
        &self.shared.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let shared = &*self.shared;
        let field = shared.info.field(column);
        let read = match (&shared.columns[column], out) {
            (Source::Array(array), out) => {
                let first = shared.first[episode] + steps.first;
                array.read((first, steps.count, steps.stride), out, &mut self.scratch)
            }
            (Source::Images(folder), SliceMut::U8(out)) => {
                let checksum =
                    shared.entries.get(episode).and_then(|entry| entry.checksums.get(column).copied());
                let reader = self.images.entry(column).or_default();
                reader.read(shared.store, folder, episode as u64, (field, steps), checksum, out)
            }
            (Source::Images(_), out) => Err(wrong_type(format!("images were asked for as {}", out.dtype()))),
        };
        read.map_err(|error| shared.info.damaged(column, episode, error))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { shared: self.shared.clone(), images: BTreeMap::new(), scratch: Vec::new() })
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let shared = &*self.shared;
        let Some(entry) = shared.entries.get(episode) else { return Ok(()) };
        let (first, rows) = (shared.first[episode], entry.rows as usize);
        for (column, (source, &expected)) in shared.columns.iter().zip(&entry.checksums).enumerate() {
            let found = match source {
                Source::Array(array) => array.bytes(first, rows, &mut self.scratch).map(crc32fast::hash),
                Source::Images(folder) => shared.store.checksum(folder, episode as u64, rows),
            };
            match found {
                Ok(found) if found == expected => {}
                Ok(_) => return Err(shared.info.damaged(column, episode, CHANGED)),
                Err(error) => return Err(shared.info.damaged(column, episode, error)),
            }
        }
        Ok(())
    }
}
