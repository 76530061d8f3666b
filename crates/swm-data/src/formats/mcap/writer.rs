//! Recording into an MCAP file. After a kill at any moment, every episode whose `write_episode` returned is there: its
//! chunks are written first, the record that announces it last, and what lies behind the last such record does not
//! count. Whoever continues the file cuts it there.

use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use swm_core::error::BoxError;
use swm_core::{Batch, Dtype, EpisodeSink, EpisodeSource, Field, Metadata, Schema, Slice};
use swm_media::png;

use super::foxglove;
use super::index::{Chunk, Contents, DATASET, EPISODE, RUN, STEP_TOPIC, is_picture, topic};
use super::reader::McapDataset;
use super::records::*;
use super::rows::to_json;
use crate::dataset::{DatasetWriter, WriteMode, WriteOptions};
use crate::error::DataError;
use crate::formats::disk::write_all_at;
use crate::formats::fit::{self, check_fit};
use crate::lock::{WriterLock, beside};

/// The episode that a row belongs to, i32: a column that the writer fills itself.
const EP_IDX: &str = "ep_idx";
/// Messages of so many bytes make a chunk.
const CHUNK_BYTES: usize = 4 << 20;
/// Rows per second, for the times of messages, if nothing says more.
const ROWS_PER_SECOND: f64 = 10.0;
const LIBRARY: &str = concat!("swm-data ", env!("CARGO_PKG_VERSION"));
const JSON_SCHEMA: u16 = 1;
const IMAGE_SCHEMA: u16 = 2;

/// Writes one file.
#[derive(Debug)]
pub(super) struct McapWriter {
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

/// A file that is being recorded.
#[derive(Debug)]
struct Recording {
    file: File,
    schema: Arc<Schema>,
    contents: Contents,
    rows: u64,
}

impl McapWriter {
    /// Takes the file at `path` for itself. Nothing of it is changed before `begin`.
    pub(super) fn new(path: &Path, options: &WriteOptions) -> Result<Self, DataError> {
        let path = fit::resolve(path)?;
        let lock = WriterLock::take(&path)?;
        let exists = path.exists();
        if exists && options.mode == WriteMode::Error {
            return Err(DataError::Exists { path });
        }
        if path.is_dir() {
            return Err(DataError::record(&path, "it is a folder"));
        }
        let episodes = match options.mode {
            WriteMode::Append if exists => McapDataset::open(&path)?.num_episodes() as u64,
            _ => 0,
        };
        Ok(Self { path, options: options.clone(), state: State::Waiting, episodes, _lock: lock })
    }

    fn start(&self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<Recording, DataError> {
        let fields: Vec<Field> =
            schema.fields().iter().filter(|field| field.name != EP_IDX).cloned().collect();
        check_columns(&self.path, &fields)?;
        let failed = |source| DataError::io(&self.path, "write", source);
        let is_new = self.options.mode != WriteMode::Append || !self.path.exists();
        if is_new {
            let rate = self.options.frames_per_second.unwrap_or(ROWS_PER_SECOND);
            if !(rate.is_finite() && rate > 0.0) {
                return Err(DataError::record(&self.path, format!("{rate} frames per second are no rate")));
            }
            let head = head(&fields, (1e9 / rate).round().max(1.0) as u64);
            // Complete before it has its name.
            let draft = beside(&self.path, ".new");
            fs::write(&draft, &head).and_then(|()| fs::rename(&draft, &self.path)).map_err(failed)?;
        }
        let file = OpenOptions::new().read(true).write(true).open(&self.path).map_err(failed)?;
        let contents =
            Contents::read(&file, &self.path).map_err(|reason| DataError::damaged(&self.path, reason))?;
        let stored: Vec<Field> =
            contents.columns.iter().filter(|field| field.name != EP_IDX).cloned().collect();
        let first = contents.runs.first().map_or(metadata, |(_, first)| first);
        check_fit(&self.path, &stored, first, &fields, metadata)?;
        // What belongs to no announced episode, and the old summary.
        file.set_len(contents.end).map_err(failed)?;
        let rows = contents.episodes.iter().map(|episode| episode.rows as u64).sum();
        let runs = fit::with_run(&contents.runs, self.episodes, metadata);
        let mut recording = Recording { file, schema: schema.clone(), contents, rows };
        if runs != recording.contents.runs {
            let text = serde_json::to_string(metadata)
                .map_err(|error| DataError::record(&self.path, error.to_string()))?;
            let values = [("first_episode", self.episodes.to_string()), ("metadata", text)];
            recording.announce(RUN, &values).map_err(|reason| self.failed(reason))?;
            recording.contents.runs = runs;
        }
        Ok(recording)
    }

    fn failed(&self, reason: String) -> DataError {
        DataError::Write { path: self.path.clone(), episodes: self.episodes, reason }
    }

    fn close(&mut self) -> Result<(), DataError> {
        match std::mem::replace(&mut self.state, State::Closed) {
            State::Recording(recording) => recording.summarise().map_err(|reason| self.failed(reason)),
            State::Waiting | State::Closed => Ok(()),
        }
    }
}

impl EpisodeSink for McapWriter {
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
        match recording.write(self.episodes, rows) {
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
        Ok(self.close()?)
    }
}

impl DatasetWriter for McapWriter {
    fn num_episodes(&self) -> u64 {
        self.episodes
    }
}

impl Drop for McapWriter {
    fn drop(&mut self) {
        // A caller who wants to know calls `finish`.
        let _ = self.close();
    }
}

impl Recording {
    /// Writes the messages of an episode, then announces it.
    fn write(&mut self, episode: u64, batch: &Batch) -> Result<(), String> {
        let number =
            |value: u64| i32::try_from(value).map_err(|_| "too many episodes for the format".to_owned());
        let (index, first_chunk) = (number(episode)?, self.contents.chunks.len());
        let rows: Vec<usize> = (0..batch.rows()).collect();
        // So many rows that their messages fill a chunk or two, made in parallel.
        let row_bytes: usize = batch.schema().fields().iter().map(Field::width).sum();
        for rows in rows.chunks((CHUNK_BYTES / row_bytes.max(1)).max(64)) {
            let made: Vec<_> =
                rows.par_iter().map(|&row| self.messages(batch, row, index)).collect::<Result<_, _>>()?;
            let (mut open, mut size) = (Vec::new(), 0);
            for message in made.into_iter().flatten() {
                size += message.2.len();
                open.push(message);
                if size >= CHUNK_BYTES {
                    self.chunk(&std::mem::take(&mut open))?;
                    size = 0;
                }
            }
            self.chunk(&open)?;
        }
        let values = [
            ("index", episode.to_string()),
            ("first_row", self.rows.to_string()),
            ("rows", batch.rows().to_string()),
        ];
        self.announce(EPISODE, &values)?;
        self.rows += batch.rows() as u64;
        let chunks = first_chunk..self.contents.chunks.len();
        self.contents.episodes.push(super::index::Episode {
            rows: batch.rows(),
            chunks,
            messages: Vec::new(),
        });
        Ok(())
    }

    /// The messages of a row: channel, time, record. A picture that equals the one before is left out.
    fn messages(&self, batch: &Batch, row: usize, episode: i32) -> Result<Vec<(u16, u64, Vec<u8>)>, String> {
        let schema = batch.schema();
        let time = (self.rows + row as u64) * self.contents.row_ns;
        let message = |channel: u16, data: &[u8]| {
            let head = Content::default().u16(channel).u32(row as u32).u64(time).u64(time);
            (channel, time, head.raw(data).record(MESSAGE))
        };
        let mut messages = Vec::new();
        let mut numbers: Vec<(&Field, Slice<'_>)> = Vec::new();
        let index = [episode];
        for field in &self.contents.columns {
            let Some(column) = schema.index(&field.name).filter(|_| field.name != EP_IDX) else {
                numbers.push((field, Slice::I32(&index)));
                continue;
            };
            let width = field.width();
            let values = batch.column(column).range(row * width, width);
            let (Slice::U8(pixels), true) = (values, is_picture(field)) else {
                numbers.push((field, values));
                continue;
            };
            if row > 0 && batch.column(column).range((row - 1) * width, width) == values {
                continue;
            }
            let &[height, columns, channels] = &field.shape[..] else { continue };
            let png = png::encode_channels(height, columns, channels, pixels);
            let png = png.map_err(|error| format!("column `{}`: {error}", field.name))?;
            let wanted = topic(&field.name);
            let channel = self.contents.channels.iter().find(|(_, topic)| *topic == wanted);
            let Some(&(channel, _)) = channel else { return Err(format!("there is no channel `{wanted}`")) };
            messages.push(message(channel, &foxglove::message(time, &png, &field.name)));
        }
        let step = self.contents.channels.iter().find(|(_, topic)| topic == STEP_TOPIC);
        if let Some(&(channel, _)) = step {
            messages.push(message(channel, &to_json(numbers.into_iter())));
        }
        Ok(messages)
    }

    /// Writes messages as a chunk, and where each lies in it.
    fn chunk(&mut self, messages: &[(u16, u64, Vec<u8>)]) -> Result<(), String> {
        let (Some(first), Some(last)) = (messages.first(), messages.last()) else { return Ok(()) };
        let mut bytes = Vec::new();
        let mut places: Vec<(u16, Vec<(u64, u64)>)> = Vec::new();
        for (channel, time, record) in messages {
            let position = places.iter().position(|(there, _)| there == channel).unwrap_or_else(|| {
                places.push((*channel, Vec::new()));
                places.len() - 1
            });
            places[position].1.push((*time, bytes.len() as u64));
            bytes.extend(record);
        }
        let (times, checksum) = ([first.1, last.1], crc32fast::hash(&bytes));
        let size = bytes.len() as u64;
        let content =
            Content::default().u64(times[0]).u64(times[1]).u64(size).u32(checksum).text("").u64(size);
        let at = self.contents.end;
        self.append(&content.raw(&bytes).record(CHUNK))?;
        let length = self.contents.end - at;
        let mut indexes = Vec::new();
        for (channel, places) in places {
            indexes.push((channel, self.contents.end));
            let position = self.contents.channels.iter().position(|(id, _)| *id == channel);
            if let Some(count) = position.and_then(|position| self.contents.counts.get_mut(position)) {
                *count += places.len() as u64;
            }
            let list =
                places.iter().fold(Content::default(), |list, &(time, offset)| list.u64(time).u64(offset));
            self.append(&Content::default().u16(channel).list(&list.0).record(MESSAGE_INDEX))?;
        }
        let indexes_length = self.contents.end - at - length;
        self.contents.chunks.push(Chunk { at, length, size, checksum, times, indexes, indexes_length });
        Ok(())
    }

    /// Writes a metadata record.
    fn announce(&mut self, name: &str, values: &[(&str, String)]) -> Result<(), String> {
        let at = self.contents.end;
        self.append(&Content::default().text(name).map(values).record(METADATA))?;
        self.contents.metadata.push((name.to_owned(), at, self.contents.end - at));
        Ok(())
    }

    fn append(&mut self, record: &[u8]) -> Result<(), String> {
        write_all_at(&self.file, record, self.contents.end).map_err(|error| error.to_string())?;
        self.contents.end += record.len() as u64;
        Ok(())
    }

    /// Ends the data and writes the summary, by which other programs find their way.
    fn summarise(mut self) -> Result<(), String> {
        let announced = self.contents.end;
        // 0 stands for "no checksum".
        self.append(&Content::default().u32(0).record(DATA_END))?;
        let start = self.contents.end;
        let contents = std::mem::take(&mut self.contents);
        let mut summary = description(&contents.columns).concat();
        let times = contents.chunks.iter().flat_map(|chunk| chunk.times);
        let messages: u64 = contents.counts.iter().sum();
        let counts = contents.channels.iter().zip(&contents.counts);
        let counts = counts.fold(Content::default(), |list, ((id, _), &count)| list.u16(*id).u64(count));
        let statistics = Content::default()
            .u64(messages)
            .u16(2)
            .u32(contents.channels.len() as u32)
            .u32(0)
            .u32(contents.metadata.len() as u32)
            .u32(contents.chunks.len() as u32)
            .u64(times.clone().min().unwrap_or(0))
            .u64(times.max().unwrap_or(0))
            .list(&counts.0);
        summary.extend(statistics.record(STATISTICS));
        for chunk in &contents.chunks {
            let offsets =
                chunk.indexes.iter().fold(Content::default(), |list, &(id, at)| list.u16(id).u64(at));
            let index =
                Content::default().u64(chunk.times[0]).u64(chunk.times[1]).u64(chunk.at).u64(chunk.length);
            let index =
                index.list(&offsets.0).u64(chunk.indexes_length).text("").u64(chunk.size).u64(chunk.size);
            summary.extend(index.record(CHUNK_INDEX));
        }
        for (name, at, length) in &contents.metadata {
            summary.extend(Content::default().u64(*at).u64(*length).text(name).record(METADATA_INDEX));
        }
        // The checksum covers the summary and the footer up to itself.
        let footer = Content::default().u64(start).u64(0).u32(0).record(FOOTER);
        let (footer, _) = footer.split_at(footer.len() - 4);
        summary.extend(footer);
        let checksum = crc32fast::hash(&summary);
        summary.extend(checksum.to_le_bytes());
        summary.extend(MAGIC);
        self.contents.end = start;
        self.append(&summary)
            .and_then(|()| self.file.set_len(self.contents.end).map_err(|error| error.to_string()))
            .inspect_err(|_| {
                // Half a summary helps nobody.
                let _ = self.file.set_len(announced);
            })
    }
}

/// The beginning of a file, up to the first episode.
fn head(fields: &[Field], row_ns: u64) -> Vec<u8> {
    let mut columns = fields.to_vec();
    columns.push(Field::step(EP_IDX, Dtype::I32, &[]));
    let mut bytes = MAGIC.to_vec();
    bytes.extend(Content::default().text("").text(LIBRARY).record(HEADER));
    bytes.extend(description(&columns).concat());
    let text = serde_json::to_string(&columns).unwrap_or_default();
    let values = [("version", "1".to_owned()), ("columns", text), ("row_ns", row_ns.to_string())];
    bytes.extend(Content::default().text(DATASET).map(&values).record(METADATA));
    bytes
}

/// The records that describe messages: schemas, and a channel per topic.
fn description(columns: &[Field]) -> [Vec<u8>; 2] {
    let of = |dtype: Dtype| match dtype {
        Dtype::Bool => "boolean",
        Dtype::Str => "string",
        Dtype::U8 | Dtype::I32 | Dtype::I64 => "integer",
        Dtype::F32 | Dtype::F64 => "number",
    };
    let members: serde_json::Map<String, serde_json::Value> = columns
        .iter()
        .filter(|field| !is_picture(field))
        .map(|field| {
            let one = serde_json::json!({"type": of(field.dtype)});
            let json =
                if field.shape.is_empty() { one } else { serde_json::json!({"type": "array", "items": one}) };
            (field.name.clone(), json)
        })
        .collect();
    let json = serde_json::json!({"type": "object", "properties": members}).to_string();
    let schema = |id: u16, name: &str, encoding: &str, data: &[u8]| {
        Content::default().u16(id).text(name).text(encoding).list(data).record(SCHEMA)
    };
    let mut schemas = schema(JSON_SCHEMA, "swm.Step", "jsonschema", json.as_bytes());
    schemas.extend(schema(IMAGE_SCHEMA, foxglove::NAME, "protobuf", &foxglove::description()));
    let channel = |id: u16, schema: u16, topic: &str, encoding: &str| {
        Content::default().u16(id).u16(schema).text(topic).text(encoding).map(&[]).record(CHANNEL)
    };
    let mut channels = channel(1, JSON_SCHEMA, STEP_TOPIC, "json");
    for (at, field) in columns.iter().filter(|field| is_picture(field)).enumerate() {
        channels.extend(channel(at as u16 + 2, IMAGE_SCHEMA, &topic(&field.name), "protobuf"));
    }
    [schemas, channels]
}

/// Columns that this format can hold.
fn check_columns(path: &Path, fields: &[Field]) -> Result<(), DataError> {
    let wrong = |reason| Err(DataError::record(path, reason));
    if fields.is_empty() {
        return wrong("there are no columns".to_owned());
    }
    if fields.len() > 1000 {
        return wrong(format!("{} columns are too many", fields.len()));
    }
    for Field { name, shape, .. } in fields {
        if name.is_empty() || topic(name) == STEP_TOPIC {
            return wrong(format!("`{name}` cannot name a column: no empty name, not `step`"));
        }
        if shape.contains(&0) {
            return wrong(format!("column `{name}` has the shape {shape:?}, which holds no values"));
        }
    }
    Ok(())
}

/// Says what has to be done about an interrupted file; does it if `apply`.
pub(super) fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    let path = fit::resolve(path)?;
    let _lock = WriterLock::take(&path)?;
    let old = McapDataset::open(&path)?;
    let contents = old.contents();
    if contents.is_finished {
        return Ok(Vec::new());
    }
    let failed = |source| DataError::io(&path, "repair", source);
    let episodes = contents.episodes.len();
    let behind = fs::metadata(&path).map_err(failed)?.len() - contents.end;
    let steps = vec![
        format!("cut {behind} bytes behind the {episodes} finished episodes"),
        "write the summary, by which other programs find their way".to_owned(),
    ];
    if apply {
        let schema = old.schema().clone();
        let file = OpenOptions::new().read(true).write(true).open(&path).map_err(failed)?;
        let contents = Contents::read(&file, &path).map_err(|reason| DataError::damaged(&path, reason))?;
        file.set_len(contents.end).map_err(failed)?;
        let recording = Recording { file, schema, contents, rows: 0 };
        recording.summarise().map_err(|reason| DataError::Write {
            path: path.clone(),
            episodes: episodes as u64,
            reason,
        })?;
    }
    Ok(steps)
}
