//! Opening a folder for reading: ours by its manifest and index, those of other programs by what lies in them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::env::VARIATION_PREFIX;
use swm_core::{Field, FieldKind, Schema, SliceMut};

use super::images::{ImageReader, Store};
use super::layout::{self, EP_LEN, EP_OFFSET, Entry, INDEX, Manifest};
use crate::dataset::{CHANGED, Dataset, DatasetInfo, Origin, Steps};
use crate::error::{DataError, FormatError, wrong_type};
use crate::formats::element;
use crate::formats::labels::{Labels, number};
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
    known: Known,
    labels: Labels,
}

/// The episodes of a folder of ours.
#[derive(Clone, Debug, Default)]
pub(super) struct Known {
    /// One per episode.
    pub(super) entries: Vec<Entry>,
    /// How many of them stand in the index; the others were found by the reference's `ep_len.npz`, which is written after
    /// the values and before the index.
    pub(super) indexed: usize,
}

#[derive(Debug)]
enum Source {
    Array(Array),
    /// The subfolder.
    Images(PathBuf),
}

impl FolderDataset {
    /// Opens a folder.
    ///
    /// # Errors
    ///
    /// It is no dataset, a file of it is missing or damaged.
    pub(super) fn open(path: &Path, format: &'static str, store: Store) -> Result<Self, DataError> {
        Self::open_with(path, format, store, false)
    }

    /// As [`FolderDataset::open`]; one of ours without an index is read by the reference's, for a repair that writes ours again.
    ///
    /// # Errors
    ///
    /// As of [`FolderDataset::open`].
    pub(super) fn open_to_repair(path: &Path, format: &'static str, store: Store) -> Result<Self, DataError> {
        Self::open_with(path, format, store, true)
    }

    fn open_with(path: &Path, format: &'static str, store: Store, repairs: bool) -> Result<Self, DataError> {
        let shared = match Manifest::read(path)? {
            Some(manifest) => Shared::ours(path, format, store, manifest, repairs)?,
            None => Shared::foreign(path, format, store)?,
        };
        Ok(Self { shared: Arc::new(shared), images: BTreeMap::new(), scratch: Vec::new() })
    }

    pub(super) fn manifest(&self) -> Option<&Manifest> {
        self.shared.manifest.as_ref()
    }

    pub(super) fn known(&self) -> Known {
        self.shared.known.clone()
    }
}

impl Shared {
    fn ours(
        path: &Path,
        format: &'static str,
        store: Store,
        manifest: Manifest,
        repairs: bool,
    ) -> Result<Self, DataError> {
        let schema =
            Schema::new(manifest.columns.clone()).map_err(|error| DataError::damaged(path, error))?;
        // First: while a recording goes on, it is never behind the index that is read next.
        let witness = lengths_by_reference(path);
        let mut entries = match layout::read_index(path, manifest.columns.len())? {
            Some(entries) => entries,
            None if witness.is_empty() => {
                let holds = "the lengths and checksums of the episodes";
                return Err(layout::lost(path, INDEX, holds));
            }
            None if repairs => Vec::new(),
            None => return Err(without_index(path, witness.len())),
        };
        let indexed = entries.len();
        let agrees = entries.iter().zip(&witness).all(|(entry, &rows)| i64::from(entry.rows) == rows);
        let lost = if agrees { witness.get(indexed..).unwrap_or_default() } else { &[] };
        let (mut rows, mut first, mut lengths) = (0usize, Vec::new(), Vec::new());
        for len in entries.iter().map(|entry| entry.rows as usize).chain(lost.iter().map(|&len| len as usize))
        {
            first.push(rows);
            lengths.push(len);
            rows += len;
        }
        let columns = sources(path, store, &manifest, rows);
        let restored = columns.and_then(|columns| {
            for episode in indexed..lengths.len() {
                let rows = lengths[episode];
                let checksums =
                    columns.iter().map(|source| checksum(source, store, (episode, first[episode], rows)));
                let checksums =
                    checksums.collect::<Result<_, _>>().map_err(|error| DataError::damaged(path, error))?;
                entries.push(Entry { rows: rows as u32, checksums });
            }
            Ok(columns)
        });
        let columns = restored.map_err(|error| match lost.len() {
            0 => error,
            lost => DataError::damaged(
                path,
                format!(
                    "`ep_len.npz` knows {lost} episodes more than the index, which cannot be restored from their files: {error}; \
                     get the folder again from where it came"
                ),
            ),
        })?;
        let mut info = DatasetInfo::new(path, format, schema, lengths);
        info.runs = manifest.runs.clone().into();
        info.has_checksums = true;
        let known = Known { entries, indexed };
        let labels = Labels::of(&info.schema, info.lengths.len(), true);
        Ok(Self { info, store, columns, first, manifest: Some(manifest), known, labels })
    }

    fn foreign(path: &Path, format: &'static str, store: Store) -> Result<Self, DataError> {
        layout::check_described(path)?;
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
                Ok(array) if let Some(reason) = array.too_large() => {
                    skipped.push((column.to_owned(), reason));
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
        let labels = Labels::of(&info.schema, info.lengths.len(), false);
        Ok(Self { info, store, columns, first, manifest: None, known: Known::default(), labels })
    }
}

/// The error for a folder of ours without its index, whose other files know so many episodes.
fn without_index(path: &Path, episodes: usize) -> DataError {
    let reason = format!(
        "`{INDEX}` is missing, which holds the lengths and checksums of the episodes, as after an incomplete copy; copy that file again, \
         or make it anew for the {episodes} episodes of `{EP_LEN}.npz`, with checksums of the files as they are now, by `swm verify` with \
         `fix`"
    );
    DataError::damaged(path, reason)
}

/// Lengths of episodes by the reference's index; none if it is not whole, as after a kill.
fn lengths_by_reference(path: &Path) -> Vec<i64> {
    let array = Array::open(&layout::array(path, EP_LEN)).and_then(|array| array.integers());
    array
        .ok()
        .filter(|lengths| lengths.iter().all(|&len| i32::try_from(len).is_ok_and(|len| len > 0)))
        .unwrap_or_default()
}

/// The columns of a folder of ours, which hold so many rows.
fn sources(path: &Path, store: Store, manifest: &Manifest, rows: usize) -> Result<Vec<Source>, DataError> {
    let source = |field: &Field| {
        let holds = || format!("the column `{}`", field.name);
        if store.takes(field) {
            let folder = path.join(&field.name);
            return match rows == 0 || folder.exists() {
                true => Ok(Source::Images(folder)),
                false => Err(layout::lost(path, &field.name, &holds())),
            };
        }
        let file = layout::array(path, &field.name);
        if !file.exists() {
            return Err(layout::lost(path, &format!("{}.npz", field.name), &holds()));
        }
        let damaged = |error| DataError::damaged(&file, error);
        let array = Array::open_growing(&file, rows).map_err(damaged)?;
        if array.elements().dtype() != field.dtype || array.row_shape() != field.shape {
            let (elements, shape) = (array.elements(), array.row_shape());
            return Err(damaged(wrong_type(format!(
                "it holds {elements:?} {shape:?}, not {} {:?}",
                field.dtype, field.shape
            ))));
        }
        Ok(Source::Array(array))
    };
    manifest.columns.iter().map(source).collect()
}

/// The checksum of what a column holds of an episode: its number, its first row, its length.
fn checksum(
    source: &Source,
    store: Store,
    (episode, first, rows): (usize, usize, usize),
) -> Result<u32, FormatError> {
    match source {
        Source::Array(array) => array.bytes(first, rows, &mut Vec::new()).map(crc32fast::hash),
        Source::Images(folder) => store.checksum(folder, episode as u64, rows),
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
    let holds = [(EP_LEN, "the lengths of the episodes"), (EP_OFFSET, "the first row of each episode")];
    if let Some((name, holds)) = holds.into_iter().find(|(name, _)| !index.contains_key(*name)) {
        return Err(layout::lost(path, &format!("{name}.npz"), holds));
    }
    let (lengths, offsets) = (&index[EP_LEN], &index[EP_OFFSET]);
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

    fn origin(&self) -> Option<Origin> {
        Some(Origin::of(&self.shared.info))
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let shared = &*self.shared;
        let scratch = &mut self.scratch;
        let compared = shared.labels.check(episode, shared.info.lengths[episode], |column, row| {
            let (first, field) = (shared.first[episode] + row, shared.info.field(column));
            match &shared.columns[column] {
                Source::Array(array) => number(field.dtype, |out| array.read((first, 1, 1), out, scratch)),
                Source::Images(_) => Err(wrong_type("it holds images")),
            }
        });
        compared.map_err(|error| shared.info.damaged_episode(episode, error))?;
        let field = shared.info.field(column);
        let read = match (&shared.columns[column], out) {
            (Source::Array(array), out) => {
                let (begin, scratch) = (shared.first[episode], &mut self.scratch);
                element::read_rows(steps, field.dim(), out, |Steps { first, count, stride }, out| {
                    array.read((begin + first, count, stride), out, scratch)
                })
            }
            (Source::Images(folder), SliceMut::U8(out)) => {
                let checksum =
                    shared.known.entries.get(episode).and_then(|entry| entry.checksums.get(column).copied());
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
        let Some(entry) = shared.known.entries.get(episode) else { return Ok(()) };
        let place = (episode, shared.first[episode], entry.rows as usize);
        for (column, (source, &expected)) in shared.columns.iter().zip(&entry.checksums).enumerate() {
            match checksum(source, shared.store, place) {
                Ok(found) if found == expected => {}
                Ok(_) => return Err(shared.info.damaged(column, episode, CHANGED)),
                Err(error) => return Err(shared.info.damaged(column, episode, error)),
            }
        }
        Ok(())
    }
}
