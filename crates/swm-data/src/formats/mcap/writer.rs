//! Recording into an MCAP file. After a kill at any moment, every committed episode is there: its
//! chunks are written first, the record that commits it last, and what lies behind the last such record does not
//! count. Whoever continues the file cuts it there.

use std::fs::{self, File};
use std::path::Path;
use std::sync::Arc;

use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::{Batch, Field, Metadata, Schema, Slice};
use swm_files::{WriterLock, beside, open_own, write_all_at, write_new};
use swm_media::png;

use super::chunks::{Chunk, Compression};
use super::foxglove;
use super::index::{EPISODE, Episode, Index, RUN, STEP_TOPIC, is_image, topic};
use super::rate::{at_rate, period_ns};
use super::reader::McapDataset;
use super::records::{CHUNK, Content, MESSAGE, MESSAGE_INDEX, METADATA};
use super::rows::to_json;
use super::{FORMAT, describe, ending, summary};
use crate::dataset::Dataset;
use crate::error::{At as _, DataError, Result, missing};
use crate::recording::{self, Backend, EP_IDX, Existing, Session, SessionStart, StepIndex, check_fit};

/// Messages of so many bytes make a chunk.
const CHUNK_BYTES: usize = 4 << 20;
/// Rows per second, for the times of messages, if nothing says more.
const ROWS_PER_SECOND: f64 = 10.0;
/// Channels have numbers of 16 bits, and every column may be one.
const MAX_COLUMNS: usize = 1000;

/// How files of MCAP are recorded.
pub(super) struct McapBackend;

/// A file that is being recorded.
#[derive(Debug)]
pub(super) struct McapSession {
    file: File,
    schema: Arc<Schema>,
    index: Index,
    /// Of all bytes up to the end of the index.
    checksum: Hasher,
    /// Rows of all committed episodes.
    rows: u64,
    /// Chunks of all committed episodes.
    chunks: usize,
    /// By column of images, that of the row before: an equal one is left out.
    before: Vec<Vec<u8>>,
    assumed_rate: Option<f64>,
}

/// A message: channel, time, record.
type Message = (u16, u64, Vec<u8>);

impl Backend for McapBackend {
    type Session = McapSession;

    fn name(&self) -> &'static str {
        FORMAT.name
    }

    fn is_folder(&self) -> bool {
        false
    }

    fn is_dataset(&self, path: &Path) -> bool {
        FORMAT.detect(path)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        Ok(Box::new(McapDataset::open(path)?))
    }

    fn refuses(&self, name: &str) -> Option<&'static str> {
        match name {
            "" => Some("no empty name"),
            name if topic(name) == STEP_TOPIC => Some("the name is reserved for the table of numbers"),
            _ => None,
        }
    }

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        recording::remove_file(path)
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<McapSession, DataError> {
        let &SessionStart { path, options, schema, fields, metadata, .. } = start;
        if fields.len() > MAX_COLUMNS {
            return Err(DataError::record(path, format!("{} columns are too many", fields.len())));
        }
        let failed = |source| DataError::io(path, "write", source);
        let rows_per_second = options.frames_per_second.or(metadata.rows_per_second);
        if start.existing != Existing::Continued {
            let rate = rows_per_second.unwrap_or(ROWS_PER_SECOND);
            if !(rate.is_finite() && rate > 0.0) {
                return Err(DataError::record(path, format!("{rate} frames per second are no rate")));
            }
            let head = describe::head(fields, period_ns(rate));
            // Complete before it has its name.
            let draft = beside(path, ".new");
            write_new(&draft, &head).and_then(|()| fs::rename(&draft, path)).map_err(failed)?;
        }
        let file = open_own(path, false).map_err(failed)?;
        let index = Index::read(&file).map_err(|error| DataError::damaged(path, error))?;
        if !index.is_in_order {
            return Err(reordered(path));
        }
        let metadata = &at_rate(Metadata { rows_per_second, ..metadata.clone() }, index.row_ns);
        let stored: Vec<Field> = index.columns.iter().filter(|field| field.name != EP_IDX).cloned().collect();
        let first = index.runs.first().map_or(metadata, |(_, first)| first);
        check_fit(path, &stored, first, fields, metadata)?;
        // What belongs to no committed episode, and the old summary.
        file.set_len(index.end).map_err(failed)?;
        let runs = recording::with_run(&index.runs, start.episodes, metadata);
        let checksum = checksum_so_far(&file, &index).map_err(|error| DataError::record(path, error))?;
        let mut recording = McapSession::new(file, schema, index, checksum);
        let is_assumed = rows_per_second.is_none() && start.existing != Existing::Continued;
        recording.assumed_rate = is_assumed.then_some(ROWS_PER_SECOND);
        if runs != recording.index.runs {
            let text = serde_json::to_string(metadata).map_err(|error| DataError::record(path, error))?;
            let values = [("first_episode", start.episodes.to_string()), ("metadata", text)];
            let committed = recording.metadata(RUN, &values);
            committed.map_err(|error| DataError::write(path, start.episodes, error))?;
            recording.index.runs = runs;
        }
        Ok(recording)
    }
}

impl Session for McapSession {
    fn assumed_rate(&self) -> Option<f64> {
        self.assumed_rate
    }

    fn append(&mut self, at: StepIndex, batch: &Batch) -> Result<()> {
        let rows: Vec<usize> = (0..batch.rows()).collect();
        // So many rows that their messages fill a chunk or two, made in parallel.
        let row_bytes: usize = batch.schema().fields().iter().map(Field::dim).sum();
        for rows in rows.chunks((CHUNK_BYTES / row_bytes.max(1)).max(64)) {
            let made: Vec<_> =
                rows.par_iter().map(|&row| self.messages(batch, row, at)).collect::<Result<_, _>>()?;
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
        for (column, (field, before)) in batch.schema().fields().iter().zip(&mut self.before).enumerate() {
            if let (Slice::U8(pixels), true) = (batch.column(column), is_image(field)) {
                before.clear();
                before.extend_from_slice(&pixels[pixels.len() - field.dim()..]);
            }
        }
        Ok(())
    }

    fn commit(&mut self, end: StepIndex) -> Result<()> {
        let values = [
            ("index", end.episode.to_string()),
            ("first_row", self.rows.to_string()),
            ("rows", end.step.to_string()),
        ];
        self.metadata(EPISODE, &values)?;
        self.rows += end.step as u64;
        let chunks = self.chunks..self.index.chunks.len();
        self.chunks = chunks.end;
        self.index.episodes.push(Episode { rows: end.step, chunks, ..Episode::default() });
        Ok(())
    }

    fn sync(&mut self) -> Result<()> {
        Ok(self.file.sync_all()?)
    }

    fn close(self) -> Result<()> {
        summary::write(&self.file, &self.index, self.checksum.finalize())?;
        Ok(self.file.sync_all()?)
    }
}

impl McapSession {
    /// Continues behind the committed episodes.
    fn new(file: File, schema: &Arc<Schema>, index: Index, checksum: Hasher) -> Self {
        let rows = index.episodes.iter().map(|episode| episode.rows as u64).sum();
        let (chunks, before) = (index.chunks.len(), vec![Vec::new(); schema.fields().len()]);
        Self { file, schema: schema.clone(), index, checksum, rows, chunks, before, assumed_rate: None }
    }

    /// The messages of a row of a piece that begins at a place. An image that equals the one before is left out.
    fn messages(&self, batch: &Batch, row: usize, at: StepIndex) -> Result<Vec<Message>> {
        let schema = &self.schema;
        let (place, index) = (at.step + row, [at.episode]);
        let time = (self.rows + place as u64) * self.index.row_ns;
        let message = |channel: u16, data: &[u8]| {
            let head = Content::default().u16(channel).u32(place as u32).u64(time).u64(time);
            (channel, time, head.raw(data).record(MESSAGE))
        };
        let mut messages = Vec::new();
        let mut numbers: Vec<(&Field, Slice<'_>)> = Vec::new();
        for field in &self.index.columns {
            let Some(column) = schema.index(&field.name).filter(|_| field.name != EP_IDX) else {
                numbers.push((field, Slice::I32(&index)));
                continue;
            };
            let width = field.dim();
            let values = batch.column(column).range(row * width, width);
            let (Slice::U8(pixels), true) = (values, is_image(field)) else {
                numbers.push((field, values));
                continue;
            };
            let before = match row {
                0 => Slice::U8(&self.before[column]),
                row => batch.column(column).range((row - 1) * width, width),
            };
            if place > 0 && before == values {
                continue;
            }
            let &[height, columns, channels] = &field.shape[..] else { continue };
            let png = png::encode_channels(height, columns, channels, pixels);
            let png = png.at(format_args!("column `{}`", field.name))?;
            let wanted = topic(&field.name);
            let channel = self.index.channels.iter().find(|(_, topic)| *topic == wanted);
            let Some(&(channel, _)) = channel else {
                return Err(missing(format!("there is no channel `{wanted}`")));
            };
            messages.push(message(channel, &foxglove::message(time, &png, &field.name)));
        }
        let step = self.index.channels.iter().find(|(_, topic)| topic == STEP_TOPIC);
        if let Some(&(channel, _)) = step {
            messages.push(message(channel, &to_json(numbers.into_iter())));
        }
        Ok(messages)
    }

    /// Writes messages as a chunk, and where each lies in it.
    fn chunk(&mut self, messages: &[Message]) -> Result<()> {
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
        let at = self.index.end;
        self.append(&content.raw(&bytes).record(CHUNK))?;
        let length = self.index.end - at;
        let mut indexes = Vec::new();
        for (channel, places) in places {
            indexes.push((channel, self.index.end));
            let position = self.index.channels.iter().position(|(id, _)| *id == channel);
            if let Some(count) = position.and_then(|position| self.index.counts.get_mut(position)) {
                *count += places.len() as u64;
            }
            let list =
                places.iter().fold(Content::default(), |list, &(time, offset)| list.u64(time).u64(offset));
            self.append(&Content::default().u16(channel).list(&list.0).record(MESSAGE_INDEX))?;
        }
        let indexes_length = self.index.end - at - length;
        self.index.chunks.push(Chunk {
            at,
            length,
            stored: size,
            size,
            compression: Compression::None,
            checksum,
            times,
            indexes,
            indexes_length,
        });
        Ok(())
    }

    /// Writes a metadata record.
    fn metadata(&mut self, name: &str, values: &[(&str, String)]) -> Result<()> {
        let at = self.index.end;
        self.append(&Content::default().text(name).map(values).record(METADATA))?;
        self.index.metadata.push((name.to_owned(), at, self.index.end - at));
        Ok(())
    }

    fn append(&mut self, record: &[u8]) -> Result<()> {
        write_all_at(&self.file, record, self.index.end)?;
        self.checksum.update(record);
        self.index.end += record.len() as u64;
        Ok(())
    }
}

/// The checksum of the data up to the end of the index: a finished file says it.
fn checksum_so_far(file: &File, index: &Index) -> Result<Hasher> {
    match index.data_end {
        Some(end) if end.at == index.end && end.checksum != 0 => {
            Ok(Hasher::new_with_initial_len(end.checksum, end.at))
        }
        _ => ending::checksum(file, 0..index.end),
    }
}

/// The error for a file that another program rewrote: to cut it behind its last commit would cut messages.
fn reordered(path: &Path) -> DataError {
    let reason = "another program rewrote it, with its records in another order, in which it is read and not continued; copy it with \
                  `swm convert` first";
    DataError::request(path, reason)
}

/// Says what has to be done about an interrupted file; does it if `apply`.
pub(super) fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    let path = recording::resolve(path)?;
    let _lock = WriterLock::take(&path)?;
    let old = McapDataset::open(&path)?;
    let index = old.index();
    if index.data_end.is_some() {
        return Ok(Vec::new());
    }
    if !index.is_in_order {
        return Err(reordered(&path));
    }
    let failed = |source| DataError::io(&path, "repair", source);
    let episodes = index.episodes.len();
    let behind = fs::metadata(&path).map_err(failed)?.len() - index.end;
    let cut = (behind > 0).then(|| format!("cut {behind} bytes behind the {episodes} finished episodes"));
    let summarize = "write the summary, by which other programs find their way".to_owned();
    let steps = cut.into_iter().chain([summarize]).collect();
    if apply {
        let file = open_own(&path, false).map_err(failed)?;
        let index = Index::read(&file).map_err(|error| DataError::damaged(&path, error))?;
        file.set_len(index.end).map_err(failed)?;
        let written = checksum_so_far(&file, &index)
            .and_then(|checksum| summary::write(&file, &index, checksum.finalize()));
        written.map_err(|error| DataError::write(&path, episodes as u64, error))?;
    }
    Ok(steps)
}
