//! Reading an MCAP dataset: any row of any column, by the positions that the walk over the file found.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Column, Field, Schema, SliceMut};
use swm_files::{ReadAt as _, Readable};
use swm_media::png;

use super::chunks::Messages;
use super::ending;
use super::foxglove;
use super::index::{Episode, Index, MessageAt, OUTSIDE, STEP_TOPIC, is_image, topic};
use super::records::{MESSAGE, MESSAGE_HEAD, Reader};
use super::rows::from_json;
use crate::dataset::{CHANGED, Dataset, DatasetInfo, Origin, Steps, copy_rows};
use crate::error::{At as _, DataError, FormatError, Result, invalid, missing, wrong_type};
use crate::foreign;
use crate::recording::EP_IDX;

/// So many rows are decoded and held at once: all of most episodes, a bounded part of the longest.
const BLOCK: usize = 1 << 16;

/// An open file.
#[derive(Debug)]
pub(super) struct McapDataset {
    shared: Arc<Shared>,
    rows: Option<Rows>,
    messages: Messages,
}

/// Numbers and texts of an episode, decoded from JSON, which has no columns; those of images stay empty.
#[derive(Debug)]
struct Rows {
    episode: usize,
    /// Which [`BLOCK`] of its rows.
    block: usize,
    columns: Vec<Column>,
}

#[derive(Debug)]
struct Shared {
    info: DatasetInfo,
    file: Readable,
    /// Of the file, in bytes.
    length: u64,
    index: Index,
    /// Of each column, the position of its channel.
    channels: Vec<usize>,
}

impl McapDataset {
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        let failed = |source| DataError::io(path, "open", source);
        let file = Readable::open(path).map_err(failed)?;
        let damaged = |error: FormatError| DataError::damaged(path, error);
        let index = Index::read(&file).map_err(damaged)?;
        if index.columns.is_empty() {
            return Err(DataError::not_a_dataset(path, foreign::mcap(&index.about)));
        }
        let schema = Schema::new(index.columns.clone()).map_err(|error| damaged(error.into()))?;
        let channels = index
            .columns
            .iter()
            .map(|field| {
                let wanted = if is_image(field) { topic(&field.name) } else { STEP_TOPIC.to_owned() };
                let found = index.channels.iter().position(|(_, topic)| *topic == wanted);
                found.ok_or_else(|| damaged(missing(format!("it has no channel `{wanted}`"))))
            })
            .collect::<Result<_, _>>()?;
        let lengths = index.episodes.iter().map(|episode| episode.rows).collect();
        let mut info = DatasetInfo::new(path, super::FORMAT.name, schema, lengths);
        info.runs = index.runs.clone().into();
        info.has_checksums = true;
        let length = file.length().map_err(failed)?;
        let shared = Shared { info, file, length, index, channels };
        Ok(Self { shared: Arc::new(shared), rows: None, messages: Messages::default() })
    }

    pub(super) fn index(&self) -> &Index {
        &self.shared.index
    }

    /// Reads rows of images. A row without a message shows what the one before it shows.
    fn images(&mut self, column: usize, episode: usize, steps: Steps, out: &mut [u8]) -> Result<()> {
        let shared = self.shared.clone();
        let field = shared.info.field(column);
        let &[height, width, channels] = &field.shape[..] else { return Err(wrong_type("no images")) };
        let found = &shared.index.episodes[episode];
        let places = &found.messages[shared.channels[column]];
        let size = height * width * channels;
        let mut last: Option<(MessageAt, usize)> = None;
        for at in 0..steps.count {
            let row = steps.first + at * steps.stride;
            let behind = places.partition_point(|place| place.row as usize <= row);
            let Some(&place) = behind.checked_sub(1).and_then(|found| places.get(found)) else {
                return Err(missing(format!("row {row} has no image")));
            };
            match last {
                Some((there, copy)) if there == place => {
                    let (done, rest) = out.split_at_mut(at * size);
                    rest[..size].copy_from_slice(&done[copy * size..][..size]);
                }
                _ => {
                    let image = foxglove::image(shared.message(found, place, &mut self.messages)?)?;
                    let frame = &mut out[at * size..][..size];
                    png::decode_into(image, [height, width, channels], frame)?;
                    last = Some((place, at));
                }
            }
        }
        Ok(())
    }

    /// Reads rows of numbers or texts.
    fn values(&mut self, column: usize, episode: usize, steps: Steps, mut out: SliceMut<'_>) -> Result<()> {
        let width = self.schema().dim(column);
        let mut at = 0;
        while at < steps.count {
            let row = steps.first + at * steps.stride;
            let (block, first) = (row / BLOCK, row % BLOCK);
            let count = ((BLOCK - 1 - first) / steps.stride + 1).min(steps.count - at);
            let (here, rest) = out.split_at(count * width);
            copy_rows(
                self.load(episode, block)?[column].as_slice(),
                width,
                Steps { first, count, ..steps },
                here,
            );
            out = rest;
            at += count;
        }
        Ok(())
    }

    /// The columns of a block of an episode's rows.
    fn load(&mut self, episode: usize, block: usize) -> Result<&[Column]> {
        if self.rows.as_ref().is_none_or(|rows| (rows.episode, rows.block) != (episode, block)) {
            self.rows = None;
            let shared = self.shared.clone();
            let fields: Vec<&Field> =
                shared.info.schema.fields().iter().filter(|field| !is_image(field)).collect();
            let mut columns: Vec<Column> = fields.iter().map(|field| Column::zeros(field.dtype, 0)).collect();
            let channel = shared.index.channels.iter().position(|(_, topic)| topic == STEP_TOPIC);
            let found = &shared.index.episodes[episode];
            let places =
                channel.and_then(|channel| found.messages.get(channel)).map_or(&[][..], Vec::as_slice);
            if !fields.is_empty() && places.len() != found.rows {
                return Err(missing(format!("{} of {} rows are there", places.len(), found.rows)));
            }
            for &place in places.iter().skip(block * BLOCK).take(BLOCK) {
                from_json(shared.message(found, place, &mut self.messages)?, &fields, &mut columns)
                    .at(format_args!("row {}", place.row))?;
            }
            let own = fields.iter().position(|field| field.name == EP_IDX).map(|at| &columns[at]);
            if let Some(Column::I32(own)) = own
                && let Some(row) = own.iter().position(|&own| own as usize != episode)
            {
                let (row, own) = (block * BLOCK + row, own[row]);
                return Err(invalid(format!("row {row} is of episode {own} by its `{EP_IDX}`")));
            }
            let mut decoded = columns.into_iter();
            let all = shared.info.schema.fields().iter().map(|field| match is_image(field) {
                true => Column::zeros(field.dtype, 0),
                false => decoded.next().unwrap_or(Column::zeros(field.dtype, 0)),
            });
            self.rows = Some(Rows { episode, block, columns: all.collect() });
        }
        Ok(self.rows.as_ref().map_or(&[], |rows| &rows.columns))
    }
}

impl Shared {
    /// The data of a message.
    fn message<'a>(
        &self,
        episode: &Episode,
        place: MessageAt,
        messages: &'a mut Messages,
    ) -> Result<&'a [u8]> {
        let found = match place.chunk {
            OUTSIDE => messages.outside(&self.file, self.length, place.offset)?,
            chunk => messages.record(&self.file, &self.index.chunks, (chunk as usize, place.offset))?,
        };
        let (MESSAGE, Some((head, data))) = (found.0, found.1.split_at_checked(MESSAGE_HEAD)) else {
            return Err(invalid("a message is not where the index says"));
        };
        // Channel and number, then its time.
        let time = Reader(&head[6..]).u64()?;
        match time / self.index.row_ns.max(1) == episode.first + u64::from(place.row) {
            true => Ok(data),
            false => Err(invalid("a message has another time than the index says")),
        }
    }
}

impl Dataset for McapDataset {
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
        let read = match (is_image(self.shared.info.field(column)), out) {
            (true, SliceMut::U8(out)) => self.images(column, episode, steps, out),
            (_, out) => self.values(column, episode, steps, out),
        };
        read.map_err(|error| self.shared.info.damaged(column, episode, error))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { shared: self.shared.clone(), rows: None, messages: Messages::default() })
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        let Shared { info, file, index, .. } = &*self.shared;
        let Some(data) = index.data_end.filter(|data| data.checksum != 0) else { return Ok(()) };
        let damaged = |reason: FormatError| DataError::damaged(&info.path, reason);
        match ending::checksum(file, 0..data.at).map_err(damaged)?.finalize() {
            found if found == data.checksum => Ok(()),
            _ => Err(damaged(invalid(
                "the checksum of all its data is wrong, it was changed after it was written",
            ))),
        }
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let Shared { info, file, index, .. } = &*self.shared;
        let Some(found) = index.episodes.get(episode) else { return Ok(()) };
        let mut messages = Vec::new();
        for chunk in &index.chunks[found.chunks.clone()] {
            let read = chunk.messages(file, &mut messages);
            read.map_err(|error| info.damaged_episode(episode, error))?;
            if chunk.checksum != 0 && crc32fast::hash(&messages) != chunk.checksum {
                return Err(info.damaged_episode(episode, CHANGED));
            }
        }
        Ok(())
    }
}
