//! Opening a file for reading: which columns it has, where its episodes lie, and checks that these agree. A file
//! whose writer lives or was killed opens too, with the episodes that were finished.

use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use hdf5_metno as h5;
use swm_core::env::VARIATION_PREFIX;
use swm_core::{Field, FieldKind, Metadata, Schema, SliceMut};
use swm_files::WriterLock;

use super::attributes::Attributes;
use super::coverage;
use super::handles::library_error;
use super::layout::{EP_LEN, EP_OFFSET, element_of, is_opaque};
use super::members::Members;
use super::storage::{ColumnStorage, Scratch};
use super::superblock;
use super::torn;
use crate::dataset::{Dataset, DatasetInfo, EncodedRows, Origin, Steps};
use crate::error::DataError;
use crate::foreign;
use crate::formats::element::{self, Element, LOOKED_AT};
use crate::formats::labels::{Labels, number};
use crate::recording::{self, EP_IDX};

/// How often the library may re-read metadata that a live writer is changing. Its own default of 100 doubles its
/// pauses up to minutes when the file is simply damaged.
const METADATA_READ_ATTEMPTS: u32 = 20;
/// Cache for chunks that the library decodes; the reference's chunks of 100 frames exceed its default of 1 MiB.
const CHUNK_CACHE_BYTES: usize = 64 << 20;
/// A row above this size is taken for damage.
pub(super) const MAX_ROW_BYTES: usize = 256 << 20;

/// An open HDF5 dataset.
#[derive(Debug)]
pub(super) struct Hdf5Dataset {
    shared: Arc<Shared>,
    scratch: Scratch,
}

/// What all handles on one file share; never changed after opening.
#[derive(Debug)]
struct Shared {
    info: DatasetInfo,
    file: File,
    columns: Vec<ColumnStorage>,
    /// First rows, by episode.
    first: Vec<usize>,
    attributes: Attributes,
    chunks_end: u64,
    labels: Labels,
    /// In a file of others: rows of the shortest column, all of which episodes must have.
    whole: Option<usize>,
}

/// The rows of one episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    first: usize,
    len: usize,
}

impl Hdf5Dataset {
    /// Opens a file for reading. One whose writer was killed amid a write is repaired, if it may be written.
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        Self::open_repaired(path, || WriterLock::take(&recording::resolve(path)?).map(Some))
    }

    /// As [`Hdf5Dataset::open`], where the caller holds the writer's lock.
    pub(super) fn open_locked(path: &Path) -> Result<Self, DataError> {
        Self::open_repaired(path, || Ok(None))
    }

    fn open_repaired(
        path: &Path,
        lock: impl FnOnce() -> Result<Option<WriterLock>, DataError>,
    ) -> Result<Self, DataError> {
        let superblock = superblock::ensure_readable(path)?;
        let is_unclean = superblock.is_unclean();
        let opened = Self::open_as(path, is_unclean).or_else(|error| {
            if is_unclean
                && let Ok(_lock) = lock()
                && torn::repair(path).unwrap_or(false)
            {
                return Self::open_as(path, true);
            }
            Err(error)
        });
        // The library's words for a file without its end depend on what it meets first.
        opened.map_err(|error| superblock.missing_end(path).unwrap_or(error))
    }

    fn open_as(path: &Path, unclean: bool) -> Result<Self, DataError> {
        let library = open_library(path, unclean)?;
        let failed = |part: &str, error| DataError::damaged(path, library_error(error).at(part));
        let file = File::open(path).map_err(|source| DataError::io(path, "open", source))?;
        let length = file.metadata().map_err(|source| DataError::io(path, "open", source))?.len();
        let attributes =
            Attributes::read(&library, &file).map_err(|error| DataError::damaged(path, error))?;

        let Members { mut datasets, skipped: mut outside } =
            Members::of(&library).map_err(|error| DataError::damaged(path, error))?;
        let mut chunks_end = 0;
        // Only a repair asks for it, and it takes a pass over all chunks.
        for (name, dataset) in datasets.iter().filter(|_| unclean) {
            let end =
                ColumnStorage::chunks_end(dataset).map_err(|e| failed(&format!("chunks of `{name}`"), e))?;
            chunks_end = chunks_end.max(end);
        }

        let mut index = |name: &str| {
            let Some(at) = datasets.iter().position(|(there, _)| there == name) else {
                if let Some(reason) = foreign::of_hdf5(&Members::names(&library)) {
                    return Err(DataError::not_a_dataset(path, reason));
                }
                let why = outside.iter().find(|(there, _)| there == name).map(|(_, why)| format!(": {why}"));
                let why = why.unwrap_or_default();
                let reason = format!(
                    "it has no `{name}`, which says where episodes lie{why}; if another program wrote it, read it with h5py in Python, and {}",
                    foreign::BRING
                );
                return Err(DataError::not_a_dataset(path, reason));
            };
            let (_, dataset) = datasets.remove(at);
            if dataset.ndim() != 1 || dataset.size() as u64 > length {
                let reason = format!("`{name}` has the impossible shape {:?}", dataset.shape());
                return Err(DataError::damaged(path, reason));
            }
            dataset.read_raw::<i64>().map_err(|error| failed(&format!("`{name}`"), error))
        };
        let lengths = index(EP_LEN)?;
        let offsets = index(EP_OFFSET)?;

        let (described, mut skipped) = describe(path, datasets, attributes.columns.as_deref())?;
        skipped.append(&mut outside);
        let available =
            described.iter().map(|column| (column.field.name.as_str(), column.rows)).min_by_key(|c| c.1);
        let episodes = spans(path, &lengths, &offsets, available, unclean)?;
        let whole = available.map(|(_, rows)| rows).filter(|_| attributes.columns.is_none() && !unclean);
        let rows = episodes.iter().map(|span| span.first + span.len).max().unwrap_or(0);

        let (mut fields, mut columns) = (Vec::new(), Vec::new());
        for Described { field, element, dataset, is_opaque, .. } in described {
            let storage = ColumnStorage::of(dataset, &field, element, rows, length)
                .map_err(|error| failed(&format!("column `{}`", field.name), error))?;
            if let Some(row) = storage.first_row_behind(length).filter(|&row| row < rows) {
                let reason =
                    format!("it was cut short: row {row} of column `{}` lies behind its end", field.name);
                return Err(DataError::damaged(path, reason));
            }
            let unread = match element {
                Element::Bf16 if is_opaque && storage.is_by_library() => Some(OPAQUE.to_owned()),
                Element::U64 => element::too_large(LOOKED_AT, rows, field.dim(), |steps, out| {
                    storage.read(&file, &field, steps, out, &mut Scratch::default())
                }),
                // Those of this program are right, whoever reads them.
                Element::FixedText(_) if attributes.columns.is_some() => None,
                _ => storage.unread_text(rows).map(str::to_owned),
            };
            match unread {
                Some(reason) => skipped.push((field.name, reason)),
                None => {
                    fields.push(field);
                    columns.push(storage);
                }
            }
        }
        let schema = Schema::new(fields).map_err(|error| DataError::damaged(path, error))?;
        let lengths = episodes.iter().map(|span| span.len).collect();
        let mut info = DatasetInfo::new(path, super::FORMAT.name, schema, lengths);
        info.runs = attributes.runs.clone().into();
        info.skipped = skipped.into();
        info.has_checksums = columns.iter().any(ColumnStorage::is_checksummed);
        let first = episodes.iter().map(|span| span.first).collect();
        let labels = Labels::of(&info.schema, info.lengths.len(), attributes.columns.is_some());
        let shared = Shared { info, file, columns, first, attributes, chunks_end, labels, whole };
        Ok(Self { shared: Arc::new(shared), scratch: Scratch::default() })
    }

    /// The description of the file.
    pub(super) fn attributes(&self) -> &Attributes {
        &self.shared.attributes
    }

    /// Columns and first run, if this program made the file and can continue it.
    pub(super) fn ours(&self) -> Option<(&[Field], &Metadata)> {
        let Attributes { columns, runs } = self.attributes();
        // Filled by the writer, and opened by its name: it must be among the columns that were looked at.
        self.schema().index(EP_IDX)?;
        Some((columns.as_deref()?, &runs.first()?.1))
    }

    /// Rows of all episodes, which lie end to end in our own files.
    pub(super) fn total_rows(&self) -> usize {
        let last = self.shared.first.last().zip(self.info().lengths.last());
        last.map_or(0, |(first, len)| first + len)
    }

    /// The address behind the last chunk; 0 for a file that was closed properly.
    pub(super) fn chunks_end(&self) -> u64 {
        self.shared.chunks_end
    }
}

impl Dataset for Hdf5Dataset {
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
        let Shared { info, file, columns, labels, first, .. } = &*self.shared;
        let begin = first[episode];
        let scratch = &mut self.scratch;
        let compared = labels.check(episode, info.lengths[episode], |column, row| {
            let (field, steps) = (info.field(column), Steps { first: begin + row, count: 1, stride: 1 });
            number(field.dtype, |out| columns[column].read(file, field, steps, out, scratch))
        });
        compared.map_err(|error| info.damaged_episode(episode, error))?;
        let (field, scratch) = (info.field(column), &mut self.scratch);
        let read = element::read_rows(steps, field.dim(), out, |steps, out| {
            let rows = Steps { first: begin + steps.first, ..steps };
            columns[column].read(file, field, rows, out, scratch)
        });
        read.map_err(|error| info.damaged(column, episode, error))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { shared: self.shared.clone(), scratch: Scratch::default() })
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        let Shared { info, first, whole: Some(rows), .. } = &*self.shared else { return Ok(()) };
        coverage::check(first, &info.lengths, *rows).map_err(|error| DataError::damaged(&info.path, error))
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let Shared { info, file, columns, first, .. } = &*self.shared;
        let Some(&first) = first.get(episode) else { return Ok(()) };
        let mut buffer = Vec::new();
        for (column, storage) in columns.iter().enumerate() {
            let checked = storage.check(file, first..first + info.lengths[episode], &mut buffer);
            checked.map_err(|error| info.damaged(column, episode, error))?;
        }
        Ok(())
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        self.shared.columns.get(column)?.encoding()
    }

    fn encoded_rows(
        &mut self,
        column: usize,
        episode: usize,
        rows: Range<usize>,
        out: &mut EncodedRows,
    ) -> Result<(), DataError> {
        let Shared { info, file, columns, first, .. } = &*self.shared;
        let rows = first[episode] + rows.start..first[episode] + rows.end;
        let read = columns[column].read_encoded(file, rows, out, &mut self.scratch);
        read.map_err(|error| info.damaged(column, episode, error))
    }
}

/// Opens with the library. A file that was not closed can only be opened as one that is being written.
pub(super) fn open_library(path: &Path, unclean: bool) -> Result<h5::File, DataError> {
    let mut builder = h5::File::with_options();
    builder
        .fapl()
        .metadata_read_attempts(METADATA_READ_ATTEMPTS)
        .chunk_cache(521, CHUNK_CACHE_BYTES, 0.75)
        // Reading needs no lock: what is finished is never changed. Held, it would stop writers, and be handed down
        // to child processes.
        .file_locking(false);
    let mode = if unclean { h5::OpenMode::ReadSWMR } else { h5::OpenMode::Read };
    builder.open_as(path, mode).map_err(|error| DataError::damaged(path, library_error(error)))
}

/// What is said of a column of bfloat16 that h5py stored, where its chunks are not read here but by the library.
const OPAQUE: &str = "it holds bfloat16, which h5py stores as opaque bytes, in chunks or with filters in which such bytes are not read; \
                      store it as float32, or without chunks";

/// Names of root datasets that are no columns, with the reason.
type Skipped = Vec<(String, String)>;

/// A root dataset that can be a column.
struct Described {
    field: Field,
    element: Element,
    dataset: h5::Dataset,
    rows: usize,
    /// Whether the library cannot convert the elements.
    is_opaque: bool,
}

/// Type, shape and kind of every column: ours first, in the order of the attribute, then others by name.
fn describe(
    path: &Path,
    datasets: Vec<(String, h5::Dataset)>,
    ours: Option<&[Field]>,
) -> Result<(Vec<Described>, Skipped), DataError> {
    let ours = ours.unwrap_or_default();
    let (mut columns, mut skipped) = (Vec::new(), Skipped::new());
    for (name, dataset) in datasets {
        let shape = dataset.space().map(|space| space.shape());
        let found = dataset.dtype().map_err(library_error);
        let found = found.and_then(|dtype| Ok((element_of(&dtype)?, is_opaque(&dtype))));
        let (shape, (element, is_opaque)) = match (shape, found) {
            (Ok(shape), Ok(found)) => (shape, found),
            (Err(error), _) => {
                let error = library_error(error).at(format_args!("column `{name}`"));
                return Err(DataError::damaged(path, error));
            }
            (_, Err(error)) => {
                skipped.push((name, error.to_string()));
                continue;
            }
        };
        let Some((&rows, shape)) = shape.split_first() else {
            skipped.push((name, "it is a single value, not one per row".to_owned()));
            continue;
        };
        let bytes =
            shape.iter().try_fold(element.size().unwrap_or(1), |bytes, &size| bytes.checked_mul(size));
        if bytes.is_none_or(|bytes| bytes > MAX_ROW_BYTES) {
            return Err(DataError::damaged(
                path,
                format!("a row of column `{name}` has the shape {shape:?}"),
            ));
        }
        let kind = if name.starts_with(VARIATION_PREFIX) { FieldKind::Episode } else { FieldKind::Step };
        let field = Field { name, dtype: element.dtype(), shape: shape.to_vec(), kind };
        columns.push(Described { field, element, dataset, rows, is_opaque });
    }
    for (at, expected) in ours.iter().enumerate() {
        let found = columns.iter().position(|column| {
            let Field { name, dtype, shape, .. } = &column.field;
            *name == expected.name && *dtype == expected.dtype && *shape == expected.shape
        });
        let Some(found) = found else {
            let Field { name, dtype, shape, .. } = expected;
            return Err(DataError::damaged(
                path,
                format!("it should have a column `{name}` of {dtype} {shape:?}"),
            ));
        };
        columns[found].field.kind = expected.kind;
        let column = columns.remove(found);
        columns.insert(at.min(columns.len()), column);
    }
    Ok((columns, skipped))
}

/// Where episodes lie. `shortest` is the column with the fewest rows. After a recording that ended badly, one half
/// of the index may name one episode more than the other, and columns may hold rows of an unfinished episode.
fn spans(
    path: &Path,
    lengths: &[i64],
    offsets: &[i64],
    shortest: Option<(&str, usize)>,
    unclean: bool,
) -> Result<Vec<Span>, DataError> {
    let Some((shortest, rows)) = shortest else {
        return Err(DataError::not_a_dataset(path, "it has no columns"));
    };
    let mut spans = Vec::with_capacity(lengths.len().min(offsets.len()));
    for (episode, (&len, &offset)) in lengths.iter().zip(offsets).enumerate() {
        let span = usize::try_from(offset).ok().zip(usize::try_from(len).ok());
        match span {
            Some((first, len)) if first.checked_add(len).is_some_and(|end| end <= rows) => {
                spans.push(Span { first, len });
            }
            _ if unclean => break,
            _ => {
                let reason = format!(
                    "episode {episode} has {len} rows from row {offset} on, but column `{shortest}` has {rows}"
                );
                return Err(DataError::damaged(path, reason));
            }
        }
    }
    Ok(spans)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_that_do_not_fit_are_damage_or_the_end_of_a_killed_recording() {
        let path = Path::new("x.h5");
        let spans = |lengths: &[i64], offsets: &[i64], unclean| {
            spans(path, lengths, offsets, Some(("state", 10)), unclean)
        };
        assert_eq!(spans(&[4, 6], &[0, 4], false).unwrap()[1], Span { first: 4, len: 6 });
        let message = spans(&[4, 7], &[0, 4], false).unwrap_err().to_string();
        assert!(message.contains("episode 1") && message.contains("`state` has 10"), "{message}");
        assert!(spans(&[-1], &[0], false).is_err());
        assert!(spans(&[1], &[i64::MAX], false).is_err());
        assert_eq!(spans(&[4, 7], &[0, 4], true).unwrap().len(), 1);
        assert_eq!(spans(&[4], &[0, 4], false).unwrap().len(), 1);
    }
}
