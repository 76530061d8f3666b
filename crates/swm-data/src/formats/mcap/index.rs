//! What a file holds, found by walking over its records without reading the messages: columns, runs, and for every
//! committed episode where its messages lie.

use std::fs::File;
use std::path::Path;

use swm_core::{Dtype, Field, Metadata};

use super::chunks::{Chunk, Messages};
use super::ending::{self, DataEnd, Footer};
use super::records::{CHANNEL, CHUNK, DATA_END, HEAD, MAGIC, MESSAGE_INDEX, METADATA, Reader};
use crate::error::{At as _, Result, invalid, missing};
use crate::formats::disk::read_exact_at;

/// Metadata record: the columns.
pub(super) const DATASET: &str = "swm.dataset";
/// Metadata record: a run and its first episode.
pub(super) const RUN: &str = "swm.run";
/// Metadata record: commits the episode before it.
pub(super) const EPISODE: &str = "swm.episode";
/// Topic of the rows of numbers and texts.
pub(super) const STEP_TOPIC: &str = "/step";
/// A record other than a chunk above this size is taken for damage.
const MAX_RECORD: u64 = 256 << 20;

/// The topic of a column of images.
pub(super) fn topic(column: &str) -> String {
    format!("/{column}")
}

/// Whether a column becomes images.
pub(super) fn is_image(field: &Field) -> bool {
    field.dtype == Dtype::U8 && matches!(field.shape[..], [_, _, 1 | 3])
}

/// A message: its row in the episode, its chunk, and where in that its record begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessageAt {
    pub(super) row: u32,
    pub(super) chunk: u32,
    pub(super) offset: u64,
}

/// A committed episode.
#[derive(Clone, Debug, Default)]
pub(super) struct Episode {
    pub(super) rows: usize,
    /// Its chunks in [`Index::chunks`].
    pub(super) chunks: std::ops::Range<usize>,
    /// By channel: its messages, in the order of rows.
    pub(super) messages: Vec<Vec<MessageAt>>,
}

/// What a file holds.
#[derive(Debug, Default)]
pub(super) struct Index {
    pub(super) columns: Vec<Field>,
    /// Nanoseconds from one row to the next.
    pub(super) row_ns: u64,
    pub(super) runs: Vec<(u64, Metadata)>,
    pub(super) channels: Vec<(u16, String)>,
    pub(super) chunks: Vec<Chunk>,
    /// Number of messages by channel, in committed episodes.
    pub(super) counts: Vec<u64>,
    pub(super) episodes: Vec<Episode>,
    /// Metadata records: name, position, length.
    pub(super) metadata: Vec<(String, u64, u64)>,
    /// Behind the last record that counts.
    pub(super) end: u64,
    /// Where the data ends in a file whose summary is there.
    pub(super) data_end: Option<DataEnd>,
}

impl Index {
    /// Walks over a file. Errors say what is damaged. A file that just ends is that of a killed recording, if it was not
    /// finished and no later episode was committed.
    pub(super) fn read(file: &File, path: &Path) -> Result<Self> {
        let length = file.metadata()?.len();
        let mut magic = [0; MAGIC.len()];
        read_exact_at(file, &mut magic, 0).map_err(|_| invalid("it is shorter than its head"))?;
        if &magic != MAGIC {
            return Err(invalid("it does not begin as an MCAP file"));
        }
        let footer = Footer::read(file, length)?;
        let mut data_end = None;
        let mut found = Self { end: MAGIC.len() as u64, ..Self::default() };
        let mut open = Episode::default();
        let mut at = MAGIC.len() as u64;
        while at + HEAD <= length {
            let mut head = [0; HEAD as usize];
            read_exact_at(file, &mut head, at)?;
            let size = Reader(&head[1..]).u64()?;
            let Some(end) = at.checked_add(HEAD + size).filter(|&end| end <= length && size <= length) else {
                break;
            };
            let content = |limit: u64| {
                if size > limit {
                    return Err(invalid(format!("a record of {size} bytes")));
                }
                let mut bytes = vec![0; size as usize];
                read_exact_at(file, &mut bytes, at + HEAD)?;
                Ok(bytes)
            };
            match head[0] {
                CHANNEL => found.channel(&content(MAX_RECORD)?)?,
                METADATA => {
                    let bytes = content(MAX_RECORD)?;
                    let mut reader = Reader(&bytes);
                    let name = reader.text()?.to_owned();
                    found.record(&name, &reader.map()?, &mut open)?;
                    found.metadata.push((name, at, end - at));
                    found.end = end;
                }
                CHUNK => found.chunks.push(Chunk::read(file, at, size)?),
                MESSAGE_INDEX => found.messages(file, &content(MAX_RECORD)?, (at, end), &mut open)?,
                DATA_END => {
                    data_end = Some(DataEnd { at, end, checksum: Reader(&content(MAX_RECORD)?).u32()? });
                    break;
                }
                // Later versions may have other records.
                _ => {}
            }
            at = end;
        }
        match footer {
            Some(footer) => {
                let end = data_end.filter(|end| footer.follows(end)).ok_or_else(|| {
                    invalid(format!(
                        "it was finished, but the record at byte {at}, behind {} episodes, is not what was written there; \
                         get the file again from where it came",
                        found.episodes.len()
                    ))
                })?;
                footer.check(file, length, [found.metadata.len(), found.chunks.len()])?;
                found.data_end = Some(end);
            }
            None => ending::check_cut(file, found.end..length, found.episodes.len() as u64)?,
        }
        let committed = found.episodes.last().map_or(0, |episode: &Episode| episode.chunks.end);
        found.chunks.truncate(committed);
        if found.columns.is_empty() {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            return Err(missing(format!(
                "`{name}` is an MCAP file, but has no record `{DATASET}` that names its columns"
            )));
        }
        Ok(found)
    }

    fn channel(&mut self, bytes: &[u8]) -> Result<()> {
        let mut reader = Reader(bytes);
        let id = reader.u16()?;
        reader.u16()?;
        let topic = reader.text()?.to_owned();
        if self.channels.iter().all(|(there, _)| *there != id) {
            self.channels.push((id, topic));
            self.counts.push(0);
        }
        Ok(())
    }

    fn record(
        &mut self,
        name: &str,
        values: &std::collections::BTreeMap<&str, &str>,
        open: &mut Episode,
    ) -> Result<()> {
        let place = format_args!("record `{name}`");
        let value = |key: &str| values.get(key).copied().ok_or(missing(format!("{place} has no `{key}`")));
        let number =
            |key| value(key)?.parse::<u64>().map_err(|_| invalid(format!("{place}: `{key}` is no number")));
        match name {
            DATASET => {
                self.columns = serde_json::from_str(value("columns")?).at(place)?;
                self.row_ns = number("row_ns")?;
                for Field { name, shape, .. } in &self.columns {
                    let bytes = shape.iter().try_fold(8usize, |bytes, &size| bytes.checked_mul(size));
                    if bytes.is_none_or(|bytes| bytes == 0 || bytes > 1 << 30) {
                        return Err(invalid(format!("a row of column `{name}` has the shape {shape:?}")));
                    }
                }
            }
            RUN => {
                let first = number("first_episode")?;
                let metadata = serde_json::from_str(value("metadata")?).at(place)?;
                self.runs.retain(|(there, _)| *there < first);
                self.runs.push((first, at_rate(metadata, self.row_ns)));
            }
            EPISODE => {
                let (index, rows, next) = (number("index")?, number("rows")? as usize, self.episodes.len());
                if index != next as u64 {
                    return Err(invalid(format!("episode {index} stands in the place of {next}")));
                }
                let first = self.episodes.last().map_or(0, |episode| episode.chunks.end);
                let mut episode = Episode { rows, chunks: first..self.chunks.len(), ..std::mem::take(open) };
                episode.messages.resize(self.channels.len(), Vec::new());
                for messages in &mut episode.messages {
                    messages.sort_by_key(|place| place.row);
                    if messages.last().is_some_and(|place| place.row as usize >= rows) {
                        return Err(invalid(format!("episode {index} has messages behind its {rows} rows")));
                    }
                }
                let step = self.channels.iter().position(|(_, topic)| topic == STEP_TOPIC);
                if step.is_none_or(|step| episode.messages[step].len() != rows) {
                    return Err(missing(format!(
                        "episode {index} should have {rows} messages on `{STEP_TOPIC}`"
                    )));
                }
                for (count, messages) in self.counts.iter_mut().zip(&episode.messages) {
                    *count += messages.len() as u64;
                }
                self.episodes.push(episode);
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes the index of one channel's messages in the chunk before it. Times are rows.
    fn messages(
        &mut self,
        file: &File,
        bytes: &[u8],
        (at, end): (u64, u64),
        open: &mut Episode,
    ) -> Result<()> {
        let first_row: u64 = self.episodes.iter().map(|episode| episode.rows as u64).sum();
        let index = self.chunks.len().checked_sub(1).ok_or(missing("an index without a chunk"))?;
        let chunk = &mut self.chunks[index];
        let mut reader = Reader(bytes);
        let channel = reader.u16()?;
        chunk.indexes.push((channel, at));
        chunk.indexes_length += end - at;
        let size = chunk.size;
        if self.channels.iter().all(|(id, _)| *id != channel) {
            // Other writers describe channels inside of chunks.
            for content in channels_within(file, &self.chunks[index])? {
                self.channel(&content)?;
            }
        }
        let Some(position) = self.channels.iter().position(|(id, _)| *id == channel) else {
            return Err(invalid(format!("messages of channel {channel}, which does not exist")));
        };
        open.messages.resize(open.messages.len().max(self.channels.len()), Vec::new());
        reader.u32()?;
        while !reader.0.is_empty() {
            let (time, offset) = (reader.u64()?, reader.u64()?);
            let row =
                (time / self.row_ns.max(1)).checked_sub(first_row).and_then(|row| u32::try_from(row).ok());
            let Some(row) = row.filter(|_| offset < size) else {
                return Err(invalid("a message lies outside its episode"));
            };
            open.messages[position].push(MessageAt { row, chunk: index as u32, offset });
        }
        Ok(())
    }
}

/// The contents of channel records among the messages of a chunk.
fn channels_within(file: &File, chunk: &Chunk) -> Result<Vec<Vec<u8>>> {
    let (mut found, mut at) = (Vec::new(), 0);
    let (mut messages, chunk) = (Messages::default(), std::slice::from_ref(chunk));
    while at + HEAD <= chunk[0].size {
        let (kind, content) = messages.record(file, chunk, (0, at))?;
        at += HEAD + content.len() as u64;
        if kind == CHANNEL {
            found.push(content.to_vec());
        }
    }
    Ok(found)
}

/// The time from one row to the next in nanoseconds.
pub(super) fn period_ns(rows_per_second: f64) -> u64 {
    (1e9 / rows_per_second).round().max(1.0) as u64
}

/// The record of a run whose messages follow each other after so many nanoseconds: its own rate, up to rounding, unless another was
/// asked for when it was written.
pub(super) fn at_rate(run: Metadata, row_ns: u64) -> Metadata {
    let exact = 1e9 / row_ns.max(1) as f64;
    // A period is rounded to whole nanoseconds; people ask for 30 or 29.97.
    let asked = (exact * 1e3).round() / 1e3;
    let of_messages = if period_ns(asked) == row_ns { asked } else { exact };
    let rate = |own| if period_ns(own) == row_ns { own } else { of_messages };
    Metadata { rows_per_second: run.rows_per_second.map(rate), ..run }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_is_not_that_of_the_messages_is_corrected() {
        let said = |own, row_ns| {
            at_rate(Metadata { rows_per_second: own, ..Metadata::default() }, row_ns).rows_per_second
        };
        for rate in [30.0, 29.97, 10.0, 0.5] {
            assert_eq!(said(Some(7.0), period_ns(rate)), Some(rate));
        }
        assert_eq!(said(Some(1.0 / 0.03), 30_000_000), Some(1.0 / 0.03));
        assert_eq!(said(None, 30_000_000), None);
        assert!(said(Some(10.0), 0).is_some_and(f64::is_finite));
    }
}
