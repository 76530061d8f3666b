//! Recording. After a kill at any moment, every episode whose `write_episode` returned is in the file: its columns
//! reach the disk first, then the episode's offset, then its length, and a reader counts an episode only when it has
//! both. (Against the end of the process, that is; the loss of power is the file system's affair.)

use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, EpisodeSource, Field, Metadata, Schema, Slice};

use super::create::{self, EndOfData};
use super::handles::{Handles, reason};
use super::layout::{EP_IDX, EP_LEN, EP_OFFSET};
use super::library;
use super::reader::Hdf5Dataset;
use crate::dataset::{DatasetWriter, WriteMode};
use crate::error::DataError;
use crate::formats::fit;
use crate::lock::WriterLock;

/// Writes one file.
#[derive(Debug)]
pub(super) struct Hdf5Writer {
    path: PathBuf,
    mode: WriteMode,
    state: State,
    episodes: u64,
    /// Declared last: the file must be closed before another writer may have it.
    _lock: WriterLock,
}

#[derive(Debug)]
enum State {
    /// Before `begin`.
    Waiting,
    Recording(Box<Recording>),
    /// Ended, cleanly or by an error.
    Closed,
}

#[derive(Debug)]
struct Recording {
    handles: Handles,
    schema: Arc<Schema>,
    /// Positions in the schema of the columns that are stored as they are given (all but `ep_idx`).
    stored: Vec<usize>,
    rows: usize,
    ep_idx: Vec<i32>,
}

impl Hdf5Writer {
    /// Takes the file at `path` for itself. Nothing of it is changed before `begin`.
    pub(super) fn new(path: &Path, mode: WriteMode) -> Result<Self, DataError> {
        let path = fit::resolve(path)?;
        let lock = WriterLock::take(&path)?;
        let exists = path.exists();
        if exists && mode == WriteMode::Error {
            return Err(DataError::Exists { path });
        }
        if path.is_dir() {
            return Err(DataError::record(&path, "it is a folder"));
        }
        let episodes = match mode {
            WriteMode::Append if exists => Hdf5Dataset::open(&path)?.num_episodes() as u64,
            _ => 0,
        };
        Ok(Self { path, mode, state: State::Waiting, episodes, _lock: lock })
    }

    fn start(&self, fields: &[Field], metadata: &Metadata) -> Result<(Handles, usize), DataError> {
        if self.mode != WriteMode::Append || !self.path.exists() {
            return Ok((create::create(&self.path, fields, metadata)?, 0));
        }
        // Closed again before the library opens the file for writing.
        let end = {
            let old = Hdf5Dataset::open(&self.path)?;
            check_old(&self.path, &old, fields, metadata)?;
            EndOfData {
                episodes: old.num_episodes(),
                rows: old.total_rows(),
                chunks_end: old.chunks_end(),
                attributes: old.attributes().clone(),
            }
        };
        Ok((create::reopen(&self.path, fields, &end, metadata)?, end.rows))
    }

    fn close(&mut self) -> Result<(), DataError> {
        match std::mem::replace(&mut self.state, State::Closed) {
            State::Recording(recording) => recording.handles.close().map_err(|reason| self.failed(reason)),
            State::Waiting | State::Closed => Ok(()),
        }
    }

    fn failed(&self, reason: String) -> DataError {
        DataError::Write { path: self.path.clone(), episodes: self.episodes, reason }
    }
}

impl EpisodeSink for Hdf5Writer {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        if !matches!(self.state, State::Waiting) {
            return Err(DataError::record(&self.path, "the recording has begun already").into());
        }
        let stored: Vec<usize> =
            (0..schema.fields().len()).filter(|&index| schema.fields()[index].name != EP_IDX).collect();
        let fields: Vec<Field> = stored.iter().map(|&index| schema.fields()[index].clone()).collect();
        check_columns(&self.path, &fields)?;
        let (handles, rows) = self.start(&fields, metadata)?;
        let recording = Recording { handles, schema: schema.clone(), stored, rows, ep_idx: Vec::new() };
        self.state = State::Recording(Box::new(recording));
        Ok(self.episodes)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        let State::Recording(recording) = &mut self.state else {
            return Err(DataError::record(&self.path, "no recording is going on").into());
        };
        if rows.schema() != &recording.schema {
            return Err(
                DataError::record(&self.path, "the episode has other columns than the recording").into()
            );
        }
        if rows.rows() == 0 {
            return Err(DataError::record(&self.path, "an episode without rows").into());
        }
        let written = recording.write(self.episodes, rows);
        match written {
            Ok(()) => {
                self.episodes += 1;
                Ok(())
            }
            Err(reason) => {
                if let State::Recording(recording) = std::mem::replace(&mut self.state, State::Closed) {
                    recording.handles.abandon();
                }
                Err(self.failed(reason).into())
            }
        }
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(self.close()?)
    }
}

impl DatasetWriter for Hdf5Writer {
    fn num_episodes(&self) -> u64 {
        self.episodes
    }
}

impl Drop for Hdf5Writer {
    fn drop(&mut self) {
        // A caller who wants to know calls `finish`.
        let _ = self.close();
    }
}

impl Recording {
    /// Appends an episode: columns, then offset, then length, each on its way to the disk before the next.
    fn write(&mut self, episode: u64, batch: &Batch) -> Result<(), String> {
        let number =
            |what, value: usize| i32::try_from(value).map_err(|_| format!("too many {what} for the format"));
        let index = number("episodes", episode as usize)?;
        let length = number("rows in an episode", batch.rows())?;
        let (first, end) = (self.rows, self.rows + batch.rows());
        let Handles { file, columns, ep_idx, ep_len, ep_offset } = &self.handles;

        for (dataset, &column) in columns.iter().zip(&self.stored) {
            let field = &self.schema.fields()[column];
            let written = create::set_rows(dataset, end).map_err(|error| reason(&error));
            written
                .and_then(|()| library::write(dataset, field, first, batch.rows(), batch.column(column)))
                .map_err(|error| format!("column `{}`: {error}", field.name))?;
        }
        self.ep_idx.clear();
        self.ep_idx.resize(batch.rows(), index);
        append(ep_idx, first, Slice::I32(&self.ep_idx))?;
        let flush = || file.flush().map_err(|error| reason(&error));
        flush()?;
        append(ep_offset, episode as usize, Slice::I64(&[first as i64]))?;
        flush()?;
        append(ep_len, episode as usize, Slice::I32(&[length]))?;
        flush()?;
        self.rows = end;
        Ok(())
    }
}

/// Appends scalars to a dataset that has `first` of them.
fn append(dataset: &hdf5_metno::Dataset, first: usize, values: Slice<'_>) -> Result<(), String> {
    let field = Field::step("", values.dtype(), &[]);
    create::set_rows(dataset, first + values.len()).map_err(|error| reason(&error))?;
    library::write(dataset, &field, first, values.len(), values)
}

/// Columns that this format can hold.
fn check_columns(path: &Path, fields: &[Field]) -> Result<(), DataError> {
    let wrong = |reason| Err(DataError::record(path, reason));
    if fields.is_empty() {
        return wrong("there are no columns".to_owned());
    }
    for Field { name, shape, .. } in fields {
        if [EP_LEN, EP_OFFSET].contains(&name.as_str()) {
            return wrong(format!("the name `{name}` is reserved for the index of episodes"));
        }
        if name.is_empty() || name == "." || name.contains(['/', '\0']) {
            return wrong(format!("`{name}` cannot name a column: no empty name, no `/`"));
        }
        if shape.contains(&0) {
            return wrong(format!("column `{name}` has the shape {shape:?}, which holds no values"));
        }
    }
    Ok(())
}

/// Whether episodes with these columns and settings continue `old`.
fn check_old(path: &Path, old: &Hdf5Dataset, fields: &[Field], metadata: &Metadata) -> Result<(), DataError> {
    let attributes = old.attributes();
    let (Some(columns), Some((_, first))) = (&attributes.columns, attributes.runs.first()) else {
        return Err(fit::foreign(path));
    };
    fit::check_fit(path, columns, first, fields, metadata)
}
