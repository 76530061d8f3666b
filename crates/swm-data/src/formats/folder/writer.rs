//! Recording into a folder. After a kill at any moment, every episode whose `write_episode` returned is there: its
//! values and pictures are written first, its record in the index last, and the index alone tells which episodes exist.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use swm_core::error::BoxError;
use swm_core::{Batch, Dtype, EpisodeSink, EpisodeSource, Field, Metadata, Schema, Slice};

use super::layout::{self, EP_IDX, EP_LEN, EP_OFFSET, Entry, IndexWriter, Manifest};
use super::pictures::Store;
use super::reader::FolderDataset;
use crate::dataset::{DatasetWriter, WriteMode, WriteOptions};
use crate::error::DataError;
use crate::formats::disk::is_plain_name;
use crate::formats::fit::{self, check_fit};
use crate::formats::npz::GrowingArray;
use crate::lock::WriterLock;

/// Writes one folder.
#[derive(Debug)]
pub(super) struct FolderWriter {
    path: PathBuf,
    format: &'static str,
    store: Store,
    options: WriteOptions,
    state: State,
    episodes: u64,
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

/// The files of a folder that is being recorded.
#[derive(Debug)]
pub(super) struct Recording {
    schema: Arc<Schema>,
    columns: Vec<Target>,
    ep_len: GrowingArray,
    ep_offset: GrowingArray,
    index: IndexWriter,
    rows: usize,
}

/// One column of the manifest.
#[derive(Debug)]
struct Target {
    field: Field,
    /// Its position in the schema; `None` for `ep_idx`, which is filled here.
    source: Option<usize>,
    place: Place,
}

#[derive(Debug)]
enum Place {
    Array(Box<GrowingArray>),
    Pictures(PathBuf),
}

impl FolderWriter {
    /// Takes the folder at `path` for itself. Nothing in it is changed before `begin`.
    pub(super) fn new(
        path: &Path,
        options: &WriteOptions,
        format: &'static str,
        store: Store,
    ) -> Result<Self, DataError> {
        let path = fit::resolve(path)?;
        let lock = WriterLock::take(&path)?;
        let exists = path.exists();
        if exists && options.mode == WriteMode::Error {
            return Err(DataError::Exists { path });
        }
        if exists && !path.is_dir() {
            return Err(DataError::record(&path, format!("it is a file, the format `{format}` is a folder")));
        }
        let is_new = !exists || is_empty(&path)?;
        let episodes = match options.mode {
            WriteMode::Append if !is_new => FolderDataset::open(&path, format, store)?.num_episodes() as u64,
            // Whatever is to be replaced must be a dataset.
            WriteMode::Overwrite if !is_new => {
                FolderDataset::open(&path, format, store).map_err(|error| {
                    DataError::record(&path, format!("it is a folder, but no dataset to replace: {error}"))
                })?;
                0
            }
            _ => 0,
        };
        let options = options.clone();
        Ok(Self { path, format, store, options, state: State::Waiting, episodes, _lock: lock })
    }

    fn start(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<Recording, DataError> {
        let fields: Vec<Field> =
            schema.fields().iter().filter(|field| field.name != EP_IDX).cloned().collect();
        check_columns(&self.path, &fields)?;
        let mut columns = fields.clone();
        columns.push(Field::step(EP_IDX, Dtype::I32, &[]));
        let mut manifest = Manifest::new(self.format, columns);
        let failed = |source| DataError::io(&self.path, "create", source);
        let is_new = !self.path.exists() || is_empty(&self.path)?;
        if !is_new && self.options.mode == WriteMode::Append {
            let old = FolderDataset::open(&self.path, self.format, self.store)?;
            let Some(there) = old.manifest() else { return Err(fit::foreign(&self.path)) };
            let stored: Vec<Field> =
                there.columns.iter().filter(|field| field.name != EP_IDX).cloned().collect();
            let first = there.runs.first().map_or(metadata, |(_, first)| first);
            check_fit(&self.path, &stored, first, &fields, metadata)?;
            manifest = there.clone();
        } else if !is_new {
            let old = FolderDataset::open(&self.path, self.format, self.store)?;
            let names: Vec<String> = old.schema().fields().iter().map(|field| field.name.clone()).collect();
            drop(old);
            layout::clear(&self.path, &names)?;
        }
        fs::create_dir_all(&self.path).map_err(failed)?;
        let runs = fit::with_run(&manifest.runs, self.episodes, metadata);
        let changed = runs != manifest.runs;
        manifest.runs = runs;
        let recording = Recording::open(&self.path, self.store, &manifest, schema, self.episodes as usize)?;
        // Last: with it, the folder is a dataset.
        if changed {
            manifest.write(&self.path)?;
        }
        Ok(recording)
    }

    fn failed(&self, reason: String) -> DataError {
        DataError::Write { path: self.path.clone(), episodes: self.episodes, reason }
    }
}

impl EpisodeSink for FolderWriter {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        if !matches!(self.state, State::Waiting) {
            return Err(DataError::record(&self.path, "the recording has begun already").into());
        }
        self.state = State::Recording(Box::new(self.start(schema, metadata)?));
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
        match recording.write(self.store, &self.options, self.episodes, rows) {
            Ok(()) => {
                self.episodes += 1;
                Ok(())
            }
            Err(reason) => {
                self.state = State::Closed;
                Err(self.failed(reason).into())
            }
        }
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.state = State::Closed;
        Ok(())
    }
}

impl DatasetWriter for FolderWriter {
    fn num_episodes(&self) -> u64 {
        self.episodes
    }
}

impl Recording {
    /// Opens the files of a folder whose index announces `episodes` episodes; what lies behind them is removed.
    pub(super) fn open(
        path: &Path,
        store: Store,
        manifest: &Manifest,
        schema: &Arc<Schema>,
        episodes: usize,
    ) -> Result<Self, DataError> {
        let entries = match episodes {
            0 => Vec::new(),
            _ => layout::read_index(path, manifest.columns.len())?,
        };
        let rows = entries.iter().map(|entry| entry.rows as usize).sum();
        let array = |field: &Field, rows: usize| {
            let file = layout::array(path, &field.name);
            let opened = match rows {
                0 => GrowingArray::create(&file, field),
                rows => GrowingArray::reopen(&file, field, rows)
                    .and_then(|mut array| array.finish_rows(0).map(|()| array)),
            };
            opened.map_err(|reason| DataError::damaged(&file, reason))
        };
        let mut columns = Vec::new();
        for field in &manifest.columns {
            let place = if store.takes(field) {
                let folder = path.join(&field.name);
                let made = fs::create_dir_all(&folder).and_then(|()| store.forget(&folder, episodes as u64));
                made.map_err(|source| DataError::io(&folder, "create", source))?;
                Place::Pictures(folder)
            } else {
                Place::Array(Box::new(array(field, rows)?))
            };
            let source = if field.name == EP_IDX { None } else { schema.index(&field.name) };
            columns.push(Target { field: field.clone(), source, place });
        }
        let mut ep_len = array(&Field::step(EP_LEN, Dtype::I32, &[]), 0)?;
        let mut ep_offset = array(&Field::step(EP_OFFSET, Dtype::I64, &[]), 0)?;
        let lengths: Vec<i32> = entries.iter().map(|entry| entry.rows as i32).collect();
        let offsets: Vec<i64> = entries
            .iter()
            .scan(0, |first, entry| {
                let offset = *first;
                *first += i64::from(entry.rows);
                Some(offset)
            })
            .collect();
        let damaged = |reason| DataError::damaged(path, reason);
        ep_len.append(episodes, Slice::I32(&lengths)).map_err(damaged)?;
        ep_offset.append(episodes, Slice::I64(&offsets)).map_err(damaged)?;
        let index = IndexWriter::open(path, manifest.columns.len(), episodes)?;
        Ok(Self { schema: schema.clone(), columns, ep_len, ep_offset, index, rows })
    }

    /// Appends an episode: columns, the reference's index, ours.
    fn write(
        &mut self,
        store: Store,
        options: &WriteOptions,
        episode: u64,
        batch: &Batch,
    ) -> Result<(), String> {
        let number =
            |what, value: u64| i32::try_from(value).map_err(|_| format!("too many {what} for the format"));
        let (index, length) =
            (number("episodes", episode)?, number("rows in an episode", batch.rows() as u64)?);
        let ep_idx = vec![index; batch.rows()];
        // Compression is most of the work, and columns do not know of each other.
        let write = |target: &mut Target| {
            let values = target.source.map_or(Slice::I32(&ep_idx), |column| batch.column(column));
            let written = match (&mut target.place, values) {
                (Place::Array(array), values) => array.append(batch.rows(), values),
                (Place::Pictures(folder), Slice::U8(pixels)) => {
                    store.write(folder, episode, &target.field, pixels, options)
                }
                (Place::Pictures(_), values) => Err(format!("pictures cannot hold {}", values.dtype())),
            };
            written.map_err(|error| format!("column `{}`: {error}", target.field.name))
        };
        let checksums: Vec<Result<u32, String>> = self.columns.par_iter_mut().map(write).collect();
        let checksums = checksums.into_iter().collect::<Result<_, _>>()?;
        self.ep_offset.append(1, Slice::I64(&[self.rows as i64]))?;
        self.ep_len.append(1, Slice::I32(&[length]))?;
        self.index.push(&Entry { rows: length as u32, checksums })?;
        self.rows += batch.rows();
        Ok(())
    }
}

fn is_empty(folder: &Path) -> Result<bool, DataError> {
    let mut entries = fs::read_dir(folder).map_err(|source| DataError::io(folder, "open", source))?;
    Ok(entries.next().is_none())
}

/// Columns that this format can hold.
fn check_columns(path: &Path, fields: &[Field]) -> Result<(), DataError> {
    let wrong = |reason| Err(DataError::record(path, reason));
    if fields.is_empty() {
        return wrong("there are no columns".to_owned());
    }
    for Field { name, shape, .. } in fields {
        if name.split('.').next().is_some_and(|start| [EP_LEN, EP_OFFSET].contains(&start)) {
            return wrong(format!("the name `{name}` is reserved for the index of episodes"));
        }
        if !is_plain_name(name) {
            return wrong(format!("`{name}` cannot name a column: no empty name, no `/`, `\\` or `:`"));
        }
        if shape.contains(&0) {
            return wrong(format!("column `{name}` has the shape {shape:?}, which holds no values"));
        }
    }
    Ok(())
}
