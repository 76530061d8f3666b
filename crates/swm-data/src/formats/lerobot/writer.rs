//! Recording into a LeRobot folder, version 3.0. Every episode has a table and films of its own, which are there before
//! the list of episodes names them; the list appears by renaming. So after a kill at any moment every episode whose
//! `write_episode` returned is there. `meta/info.json` follows the list, statistics follow at the end of the recording.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, EpisodeSource, Field, Metadata, Schema, Slice};
use swm_media::mp4::{self, Mp4Options};

use super::episodes::{self, Entry};
use super::info::{self, INFO};
use super::manifest::{Manifest, OWN, is_film, is_own};
use super::parquet_file::{self, ColumnOut};
use super::reader::LeRobotDataset;
use super::statistics::Statistics;
use crate::dataset::{DatasetWriter, WriteMode, WriteOptions};
use crate::error::DataError;
use crate::formats::disk::{is_plain_name, replace};
use crate::formats::film::{FRAMES_PER_SECOND, encoding};
use crate::formats::fit::{self, check_fit};
use crate::lock::WriterLock;

/// The column that readers make up.
const EP_IDX: &str = "ep_idx";

/// Writes one folder.
#[derive(Debug)]
pub(super) struct LeRobotWriter {
    path: PathBuf,
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

/// A folder that is being recorded.
#[derive(Debug)]
struct Recording {
    path: PathBuf,
    schema: Arc<Schema>,
    manifest: Manifest,
    encoding: Mp4Options,
    entries: Vec<Entry>,
    rows: usize,
    statistics: Statistics,
}

impl LeRobotWriter {
    /// Takes the folder at `path` for itself. Nothing in it is changed before `begin`.
    pub(super) fn new(path: &Path, options: &WriteOptions) -> Result<Self, DataError> {
        let path = fit::resolve(path)?;
        let lock = WriterLock::take(&path)?;
        let exists = path.exists();
        if exists && options.mode == WriteMode::Error {
            return Err(DataError::Exists { path });
        }
        if exists && !path.is_dir() {
            return Err(DataError::record(&path, "it is a file, the format `lerobot` is a folder"));
        }
        let episodes = match options.mode {
            _ if is_new(&path)? => 0,
            WriteMode::Append => LeRobotDataset::open(&path)?.num_episodes() as u64,
            // Whatever is to be replaced must be a dataset.
            _ => {
                LeRobotDataset::open(&path).map_err(|error| {
                    DataError::record(&path, format!("it is a folder, but no dataset to replace: {error}"))
                })?;
                0
            }
        };
        Ok(Self { path, options: options.clone(), state: State::Waiting, episodes, _lock: lock })
    }

    fn start(&self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<Recording, DataError> {
        let path = &self.path;
        let fields: Vec<Field> =
            schema.fields().iter().filter(|field| field.name != EP_IDX).cloned().collect();
        let rate = self.options.frames_per_second.unwrap_or(FRAMES_PER_SECOND);
        let mut manifest = Manifest::new(fields, rate);
        check_columns(path, &manifest)?;
        let is_new = is_new(path)?;
        if !is_new && self.options.mode == WriteMode::Append {
            let there = Manifest::read(path).map_err(|reason| DataError::damaged(path, reason))?;
            let there = there.ok_or_else(|| fit::foreign(path))?;
            let first = there.runs.first().map_or(metadata, |(_, first)| first);
            check_fit(path, &there.columns, first, &manifest.columns, metadata)?;
            manifest = there;
        } else if !is_new {
            clear(path)?;
        }
        let runs = fit::with_run(&manifest.runs, self.episodes, metadata);
        let changed = runs != manifest.runs;
        manifest.runs = runs;
        let meta = path.join("meta");
        fs::create_dir_all(&meta).map_err(|source| DataError::io(path, "create", source))?;
        if changed {
            manifest.write(path)?;
            episodes::write_tasks(path, &manifest)?;
        }
        let encoding =
            Mp4Options { frames_per_second: manifest.frames_per_second, ..encoding(&self.options) };
        Recording::open(path, schema, manifest, encoding)
    }
}

impl EpisodeSink for LeRobotWriter {
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
            let reason = "the episode has other columns than the recording";
            return Err(DataError::record(&self.path, reason).into());
        }
        if rows.rows() == 0 {
            return Err(DataError::record(&self.path, "an episode without rows").into());
        }
        let written = recording.write(rows);
        self.episodes = recording.entries.len() as u64;
        if let Err(reason) = written {
            self.state = State::Closed;
            let (path, episodes) = (self.path.clone(), self.episodes);
            return Err(DataError::Write { path, episodes, reason }.into());
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        if let State::Recording(recording) = std::mem::replace(&mut self.state, State::Closed) {
            recording.statistics.write(&self.path, &recording.manifest)?;
        }
        Ok(())
    }
}

impl DatasetWriter for LeRobotWriter {
    fn num_episodes(&self) -> u64 {
        self.episodes
    }
}

impl Recording {
    /// Continues behind the announced episodes; what lies behind them is removed.
    fn open(
        path: &Path,
        schema: &Arc<Schema>,
        manifest: Manifest,
        encoding: Mp4Options,
    ) -> Result<Self, DataError> {
        let damaged = |reason| DataError::damaged(path, reason);
        let entries = episodes::read(path, manifest.cameras().count()).map_err(damaged)?;
        let rows = entries.iter().map(|entry| entry.rows).sum();
        for file in leftovers(path, &manifest, entries.len()) {
            fs::remove_file(&file).map_err(|source| DataError::io(&file, "remove", source))?;
        }
        info::write(path, &manifest, entries.len(), rows)?;
        let statistics = match Statistics::read(path, &manifest, rows) {
            Some(found) => found,
            None if rows == 0 => Statistics::new(&manifest),
            None => Statistics::compute(&manifest, &mut LeRobotDataset::open(path)?)?,
        };
        Ok(Self {
            path: path.to_owned(),
            schema: schema.clone(),
            manifest,
            encoding,
            entries,
            rows,
            statistics,
        })
    }

    /// Writes an episode: its table and films, the list, the summary.
    fn write(&mut self, batch: &Batch) -> Result<(), String> {
        let episode = self.entries.len();
        let table = self.table(batch)?;
        let cameras: Vec<(&Field, String)> = self.manifest.cameras().collect();
        // Encoding is most of the work, and films do not know of each other.
        let films = cameras.par_iter().map(|(field, camera)| {
            let failed = |error: String| format!("column `{}`: {error}", field.name);
            let column = self.schema.index(&field.name).ok_or_else(|| failed("it is missing".to_owned()))?;
            let (Slice::U8(values), &[height, width, _]) = (batch.column(column), &field.shape[..]) else {
                return Err(failed("it holds no pictures".to_owned()));
            };
            let frames = values.chunks_exact(field.width());
            let film = mp4::encode_frames(frames, height, width, &self.encoding);
            let film = film.map_err(|error| failed(error.to_string()))?;
            self.store(&episodes::film_path(camera, episode), &film).map_err(failed)
        });
        let films = films.collect::<Result<Vec<u32>, String>>()?;
        // LeRobot reads all tables that there are, listed or not: the less time between a table and the list, the better.
        let mut checksums = vec![self.store(&episodes::data_path(episode), &table)?];
        checksums.extend(films);
        let said = |error: DataError| error.to_string();
        self.entries.push(Entry { rows: batch.rows(), checksums });
        if let Err(error) = episodes::announce(&self.path, &self.manifest, &self.entries) {
            self.entries.pop();
            return Err(said(error));
        }
        self.rows += batch.rows();
        self.statistics.add(&self.manifest, batch);
        info::write(&self.path, &self.manifest, self.entries.len(), self.rows).map_err(said)
    }

    /// The table of an episode: everything but films.
    fn table(&self, batch: &Batch) -> Result<Vec<u8>, String> {
        let (rows, rate) = (batch.rows(), self.manifest.frames_per_second);
        let times: Vec<f32> = (0..rows).map(|row| (row as f64 / rate) as f32).collect();
        let frames: Vec<i64> = (0..rows as i64).collect();
        let all: Vec<i64> = (self.rows as i64..(self.rows + rows) as i64).collect();
        let (episode, task) = (vec![self.entries.len() as i64; rows], vec![0i64; rows]);
        let mut columns = Vec::new();
        let stored = self.manifest.columns.iter().filter(|field| !is_film(field) && !is_own(&field.name));
        for field in stored {
            let column = self.schema.index(&field.name).ok_or("a column is missing")?;
            let list = (field.width() > 1).then(|| field.width());
            columns.push(ColumnOut {
                name: self.manifest.feature(&field.name),
                values: batch.column(column),
                list,
            });
        }
        let own = [
            Slice::F32(&times),
            Slice::I64(&frames),
            Slice::I64(&episode),
            Slice::I64(&all),
            Slice::I64(&task),
        ];
        columns.extend(OWN.iter().zip(own).map(|(&(name, _), values)| ColumnOut::scalar(name, values)));
        parquet_file::bytes(&columns, &[])
    }

    /// Writes a file of an episode and returns its checksum.
    fn store(&self, name: &str, bytes: &[u8]) -> Result<u32, String> {
        let path = self.path.join(name);
        let failed = |error: std::io::Error| format!("{}: {error}", path.display());
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(failed)?;
        }
        // LeRobot reads whatever tables lie there: half of one would be worse than none.
        replace(&path, bytes).map_err(failed)?;
        Ok(crc32fast::hash(bytes))
    }
}

/// Says what is to be done about an interrupted recording; does it if `apply`.
pub(super) fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    let _lock = WriterLock::take(path)?;
    let damaged = |reason| DataError::damaged(path, reason);
    let Some(manifest) = Manifest::read(path).map_err(damaged)? else { return Ok(Vec::new()) };
    let entries = episodes::read(path, manifest.cameras().count()).map_err(damaged)?;
    let rows = entries.iter().map(|entry| entry.rows).sum();
    let mut steps = Vec::new();
    let counted = info::Info::read(path).map_err(damaged)?.total_episodes;
    if counted != entries.len() {
        steps.push(format!("set `{INFO}` from {counted} to {} episodes", entries.len()));
    }
    if rows > 0 && Statistics::read(path, &manifest, rows).is_none() {
        steps.push("compute `meta/stats.json` anew".to_owned());
    }
    let count = leftovers(path, &manifest, entries.len()).len();
    if count > 0 {
        steps.push(format!("remove {count} files of an unfinished episode"));
    }
    if apply && !steps.is_empty() {
        let schema = LeRobotDataset::open(path)?.schema().clone();
        let recording = Recording::open(path, &schema, manifest, encoding(&WriteOptions::default()))?;
        recording.statistics.write(path, &recording.manifest)?;
    }
    Ok(steps)
}

/// Files of the episode behind the announced ones.
fn leftovers(path: &Path, manifest: &Manifest, episode: usize) -> Vec<PathBuf> {
    let films = manifest.cameras().map(|(_, camera)| episodes::film_path(&camera, episode));
    let names = std::iter::once(episodes::data_path(episode)).chain(films);
    let files = names.flat_map(|name| [path.join(format!("{name}.new")), path.join(name)]);
    files.filter(|file| file.is_file()).collect()
}

/// Whether there is nothing yet, or what a recording leaves that was killed before it began.
fn is_new(path: &Path) -> Result<bool, DataError> {
    if path.join(INFO).is_file() {
        return Ok(false);
    }
    if !path.exists() {
        return Ok(true);
    }
    let entries = fs::read_dir(path).map_err(|source| DataError::io(path, "open", source))?;
    Ok(entries.flatten().all(|entry| entry.file_name() == "meta"))
}

/// Removes a dataset from its folder; first the file by which it is one.
fn clear(path: &Path) -> Result<(), DataError> {
    let failed = |source| DataError::io(path, "clear", source);
    fs::remove_file(path.join(INFO)).map_err(failed)?;
    for folder in ["data", "videos", "meta"].map(|name| path.join(name)) {
        if folder.is_dir() {
            fs::remove_dir_all(&folder).map_err(failed)?;
        }
    }
    Ok(())
}

/// Columns that this format can hold.
fn check_columns(path: &Path, manifest: &Manifest) -> Result<(), DataError> {
    let wrong = |reason| Err(DataError::record(path, reason));
    let rate = manifest.frames_per_second;
    if !(rate.is_finite() && rate > 0.0) {
        return wrong(format!("{rate} frames per second"));
    }
    if manifest.columns.is_empty() {
        return wrong("there are no columns".to_owned());
    }
    let mut features = Vec::new();
    for Field { name, dtype, shape, .. } in &manifest.columns {
        if !is_plain_name(name) {
            return wrong(format!("`{name}` cannot name a column: no empty name, no `/`, `\\` or `:`"));
        }
        if shape.contains(&0) {
            return wrong(format!("column `{name}` has the shape {shape:?}, which holds no values"));
        }
        if OWN.iter().any(|(own, kind)| own == name && (kind != dtype || !shape.is_empty())) {
            return wrong(format!("the name `{name}` is LeRobot's own, for a single number of another kind"));
        }
        let feature = manifest.feature(name);
        if features.contains(&feature) {
            return wrong(format!("two columns would be called `{feature}`"));
        }
        features.push(feature);
    }
    Ok(())
}
