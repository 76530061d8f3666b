//! What a file holds, found by walking over its records without reading the messages: columns, runs, and for every
//! committed episode where its messages lie.

use swm_core::{Dtype, Field, Metadata};
use swm_files::{ReadAt, read_exact_at};

use super::chunks::{Chunk, Messages};
use super::ending::{self, DataEnd, Footer};
use super::rate::at_rate;
use super::records::{
    CHANNEL, CHUNK, DATA_END, HEAD, HEADER, MAGIC, MESSAGE, MESSAGE_HEAD, MESSAGE_INDEX, METADATA, Reader,
    SCHEMA,
};
use crate::error::{At as _, Result, invalid, missing};

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

/// In the place of a chunk: the message lies in none, and its record begins at that byte of the file.
pub(super) const OUTSIDE: u32 = u32::MAX;

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
    /// Its first row, over all episodes.
    pub(super) first: u64,
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
    /// Whether every episode is committed behind its messages, which are in chunks with an index: then the file can be continued.
    pub(super) is_in_order: bool,
    /// Profile, and encodings of schemas: what the file is where it has no columns.
    pub(super) about: Vec<String>,
}

/// What a walk over the records finds: messages are not told apart by episodes yet.
#[derive(Debug, Default)]
struct Found {
    commits: Vec<Commit>,
    messages: Vec<Message>,
    /// Chunks before the last record that counts.
    chunks: usize,
}

/// A record that commits an episode.
#[derive(Clone, Copy, Debug)]
struct Commit {
    episode: u64,
    rows: usize,
    /// Chunks before it.
    chunks: usize,
}

/// A message whose episode is not known yet.
#[derive(Clone, Copy, Debug)]
struct Message {
    channel: u16,
    time: u64,
    chunk: u32,
    offset: u64,
}

impl Index {
    /// Walks over a file. Errors say what is damaged. A file that just ends is that of a killed recording, if it was not
    /// finished and no later episode was committed. Which episode a message belongs to, its time tells: other programs that rewrite a
    /// file put the records in another order.
    pub(super) fn read(file: &dyn ReadAt) -> Result<Self> {
        let length = file.length()?;
        let mut magic = [0; MAGIC.len()];
        read_exact_at(file, &mut magic, 0).map_err(|_| invalid("it is shorter than its head"))?;
        if &magic != MAGIC {
            return Err(invalid("it does not begin as an MCAP file"));
        }
        let footer = Footer::read(file, length)?;
        let mut data_end = None;
        let mut index = Self { end: MAGIC.len() as u64, ..Self::default() };
        let mut found = Found::default();
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
                HEADER => index.about.push(Reader(&content(MAX_RECORD)?).text()?.to_owned()),
                SCHEMA => {
                    let bytes = content(MAX_RECORD)?;
                    let mut reader = Reader(&bytes);
                    reader.u16()?;
                    reader.text()?;
                    index.about.push(reader.text()?.to_owned());
                }
                CHANNEL => index.channel(&content(MAX_RECORD)?)?,
                METADATA => {
                    let bytes = content(MAX_RECORD)?;
                    let mut reader = Reader(&bytes);
                    let name = reader.text()?.to_owned();
                    index.record(&name, &reader.map()?, &mut found)?;
                    index.metadata.push((name, at, end - at));
                    index.end = end;
                    found.chunks = index.chunks.len();
                }
                CHUNK => index.chunks.push(Chunk::read(file, at, size)?),
                MESSAGE_INDEX => index.indexed(&content(MAX_RECORD)?, (at, end), &mut found)?,
                MESSAGE => {
                    let mut bytes = [0; MESSAGE_HEAD];
                    let head = bytes.get_mut(..size.min(MESSAGE_HEAD as u64) as usize).unwrap_or_default();
                    read_exact_at(file, head, at + HEAD)?;
                    found.messages.push(Message::read(head, OUTSIDE, at)?);
                }
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
                        found.commits.len()
                    ))
                })?;
                footer.check(file, length, [index.metadata.len(), index.chunks.len()])?;
                index.data_end = Some(end);
            }
            None => {
                ending::check_cut(file, index.end..length, found.commits.len() as u64)?;
                // What lies behind the last commit belongs to an episode that was not finished.
                index.chunks.truncate(found.chunks);
                found.messages.retain(|message| match message.chunk {
                    OUTSIDE => message.offset < index.end,
                    chunk => (chunk as usize) < found.chunks,
                });
            }
        }
        if !index.columns.is_empty() {
            let last = found.commits.last().map_or(0, |commit| commit.chunks);
            index.place(file, found)?;
            if index.is_in_order {
                index.chunks.truncate(last);
            }
        }
        Ok(index)
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
        found: &mut Found,
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
                self.runs.retain(|(there, _)| *there != first);
                self.runs.push((first, metadata));
                self.runs.sort_by_key(|(first, _)| *first);
            }
            EPISODE => {
                let (episode, rows) = (number("index")?, number("rows")? as usize);
                found.commits.push(Commit { episode, rows, chunks: self.chunks.len() });
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes the index of one channel's messages in the chunk before it.
    fn indexed(&mut self, bytes: &[u8], (at, end): (u64, u64), found: &mut Found) -> Result<()> {
        let index = self.chunks.len().checked_sub(1).ok_or(missing("an index without a chunk"))?;
        let chunk = &mut self.chunks[index];
        let mut reader = Reader(bytes);
        let channel = reader.u16()?;
        chunk.indexes.push((channel, at));
        chunk.indexes_length += end - at;
        reader.u32()?;
        while !reader.0.is_empty() {
            let (time, offset) = (reader.u64()?, reader.u64()?);
            if offset >= chunk.size {
                return Err(invalid("a message lies outside its episode"));
            }
            found.messages.push(Message { channel, time, chunk: index as u32, offset });
        }
        Ok(())
    }

    /// Takes the channels and, where it has no index, the messages of a chunk.
    fn scan(&mut self, file: &dyn ReadAt, index: usize, found: &mut Found) -> Result<()> {
        let (chunk, mut messages) = (self.chunks[index].clone(), Messages::default());
        let (is_indexed, chunk) = (!chunk.indexes.is_empty(), [chunk]);
        let mut at = 0;
        while at + HEAD <= chunk[0].size {
            let (kind, content) = messages.record(file, &chunk, (0, at))?;
            match kind {
                CHANNEL => self.channel(content)?,
                MESSAGE if !is_indexed => found.messages.push(Message::read(content, index as u32, at)?),
                _ => {}
            }
            at += HEAD + content.len() as u64;
        }
        Ok(())
    }

    /// Gives every message to its episode. Times are rows.
    fn place(&mut self, file: &dyn ReadAt, mut found: Found) -> Result<()> {
        let row_ns = self.row_ns;
        self.runs.iter_mut().for_each(|(_, run)| *run = at_rate(std::mem::take(run), row_ns));
        let mut is_in_order = found.messages.iter().all(|message| message.chunk != OUTSIDE)
            && found.commits.is_sorted_by_key(|commit| commit.episode);
        let is_unknown = found.messages.iter().any(|message| self.position(message.channel).is_none());
        for index in 0..self.chunks.len() {
            let has_index = !self.chunks[index].indexes.is_empty();
            is_in_order &= has_index;
            // Other writers describe channels inside of chunks.
            if !has_index || is_unknown {
                self.scan(file, index, &mut found)?;
            }
        }
        found.commits.sort_by_key(|commit| commit.episode);
        let mut firsts = Vec::with_capacity(found.commits.len());
        let mut rows: u64 = 0;
        for (next, commit) in found.commits.iter().enumerate() {
            if commit.episode != next as u64 {
                return Err(invalid(format!("episode {} stands in the place of {next}", commit.episode)));
            }
            firsts.push(rows);
            rows = rows.checked_add(commit.rows as u64).ok_or(invalid("its episodes are too long"))?;
            let messages = vec![Vec::new(); self.channels.len()];
            self.episodes.push(Episode {
                rows: commit.rows,
                first: firsts[next],
                messages,
                ..Episode::default()
            });
        }
        for Message { channel, time, chunk, offset } in found.messages {
            let position = self
                .position(channel)
                .ok_or_else(|| invalid(format!("messages of channel {channel}, which does not exist")))?;
            let row = time / row_ns.max(1);
            let (true, Some(episode)) =
                (row < rows, firsts.partition_point(|&first| first <= row).checked_sub(1))
            else {
                return Err(invalid("a message lies outside its episode"));
            };
            let row = (row - firsts[episode]) as u32;
            self.episodes[episode].messages[position].push(MessageAt { row, chunk, offset });
        }
        let step = self.channels.iter().position(|(_, topic)| topic == STEP_TOPIC);
        let mut before = 0;
        for (index, (episode, commit)) in self.episodes.iter_mut().zip(&found.commits).enumerate() {
            for messages in &mut episode.messages {
                messages.sort_by_key(|place| place.row);
            }
            let of_steps = step.map_or(&[][..], |step| &episode.messages[step]);
            let is_whole = of_steps.len() == commit.rows;
            if !is_whole || of_steps.iter().zip(0..).any(|(place, row)| place.row != row) {
                return Err(missing(format!(
                    "episode {index} should have {} messages on `{STEP_TOPIC}`, one a row",
                    commit.rows
                )));
            }
            let chunks = || episode.messages.iter().flatten().map(|place| place.chunk as usize);
            is_in_order &= chunks().all(|chunk| (before..commit.chunks).contains(&chunk));
            let there = || chunks().filter(|&chunk| chunk != OUTSIDE as usize);
            let span = there().min().unwrap_or(0)..there().max().map_or(0, |last| last + 1);
            episode.chunks = if is_in_order { before..commit.chunks } else { span };
            before = commit.chunks;
            for (count, messages) in self.counts.iter_mut().zip(&episode.messages) {
                *count += messages.len() as u64;
            }
        }
        self.is_in_order = is_in_order;
        Ok(())
    }

    /// The position of a channel, or of the first one of its topic.
    fn position(&self, id: u16) -> Option<usize> {
        let (_, topic) = self.channels.iter().find(|(known, _)| *known == id)?;
        self.channels.iter().position(|(_, known)| known == topic)
    }
}

impl Message {
    /// From the content of a message's record, or its head.
    fn read(content: &[u8], chunk: u32, offset: u64) -> Result<Self> {
        let mut reader = Reader(content);
        let (channel, _, time) = (reader.u16()?, reader.u32()?, reader.u64()?);
        Ok(Self { channel, time, chunk, offset })
    }
}
