//! Columns of the values of records.

use std::sync::Arc;

use swm_core::{Column, Dtype, FieldKind, SliceMut};
use swm_data::dataset::{Steps, copy_rows};
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_media::{jpeg, png};

use super::example::{List, Lists, find, floats, integers, lists, texts};
use super::features::{Feature, Kind};
use super::records::Record;
use super::{NAME, STEPS};
use crate::array::{Array, Scratch, new_key};

/// The key of the marks of last steps, and of those that end the task.
const LAST: &str = "steps/is_last";
const TERMINAL: &str = "steps/is_terminal";

/// The episodes of a part: a record each.
#[derive(Debug)]
pub(super) struct Episodes {
    records: Vec<Record>,
    lengths: Vec<usize>,
    /// The row behind each episode, of all.
    ends: Vec<usize>,
    key: usize,
}

/// A record in memory.
struct Loaded {
    bytes: Vec<u8>,
    lists: Lists,
}

impl Loaded {
    fn read(record: &Record) -> Result<Self> {
        let bytes = record.bytes()?;
        let lists = lists(&bytes)?;
        Ok(Self { bytes, lists })
    }

    fn list(&self, key: &str) -> Result<&List> {
        self.lists.get(key).ok_or_else(|| missing(format!("its record has no `{key}`")))
    }

    fn numbers(&self, key: &str) -> Result<Vec<f64>> {
        match self.list(key)? {
            List::Floats(range) => {
                Ok(floats(&self.bytes[range.clone()])?.into_iter().map(f64::from).collect())
            }
            List::Integers(range) => {
                Ok(integers(&self.bytes[range.clone()])?.into_iter().map(|value| value as f64).collect())
            }
            List::None => Ok(Vec::new()),
            List::Bytes(_) => Err(wrong_type(format!("`{key}` holds no numbers"))),
        }
    }

    fn texts(&self, key: &str) -> Result<Vec<&[u8]>> {
        match self.list(key)? {
            List::Bytes(range) => texts(&self.bytes[range.clone()]),
            List::None => Ok(Vec::new()),
            _ => Err(wrong_type(format!("`{key}` holds no bytes"))),
        }
    }

    /// Values of a key.
    fn count(&self, key: &str) -> Result<usize> {
        match self.list(key)? {
            List::Bytes(_) => self.texts(key).map(|texts| texts.len()),
            _ => self.numbers(key).map(|numbers| numbers.len()),
        }
    }
}

/// Values of a key of a record.
fn count(record: &Record, key: &str) -> Result<usize> {
    let found = find(record.length(), key, &|out, at| record.part(out, at).is_ok());
    let count = found.and_then(|(number, list)| match number {
        1 => texts(&list).ok().map(|texts| texts.len()),
        2 => floats(&list).ok().map(|floats| floats.len()),
        3 => integers(&list).ok().map(|integers| integers.len()),
        _ => None,
    });
    // What is not where it usually is, is looked for in all of the record.
    count.map_or_else(|| Loaded::read(record)?.count(key), Ok)
}

impl Episodes {
    /// The episodes of the records. How many steps one has is told by the values of one of its features.
    pub(super) fn new(records: Vec<Record>, features: &[Feature]) -> Result<Self> {
        let per_step = |feature: &Feature| -> usize {
            match &feature.kind {
                Kind::Numbers { shape, .. } => shape.iter().product(),
                Kind::Text | Kind::Image { .. } => 1,
                Kind::Skipped(_) => 0,
            }
        };
        let of_steps =
            features.iter().filter(|feature| feature.key.starts_with(STEPS) && per_step(feature) > 0);
        // Marks are the shortest of all.
        let counted =
            of_steps.min_by_key(|feature| (!feature.key.starts_with("steps/is_"), per_step(feature)));
        let counted = counted.ok_or_else(|| unsupported("it has no feature of the steps that is read"))?;
        let each = per_step(counted);
        let length = |(episode, record): (usize, &Record)| -> Result<usize> {
            Ok(count(record, &counted.key).at(format_args!("episode {episode}"))? / each)
        };
        let lengths: Vec<usize> = records.iter().enumerate().map(length).collect::<Result<_>>()?;
        let mut end = 0;
        let ends = lengths.iter().map(|length| {
            end += length;
            end
        });
        Ok(Self { ends: ends.collect(), lengths, records, key: new_key() })
    }

    pub(super) fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// A record, which is read if it is not the one of before.
    fn with<T>(
        &self,
        episode: usize,
        scratch: &mut Scratch,
        read: impl FnOnce(&Loaded) -> Result<T>,
    ) -> Result<T> {
        let record = self.records.get(episode).ok_or_else(|| invalid("it has no such episode"))?;
        let make = |_: &mut Scratch| {
            let loaded = Loaded::read(record)?;
            let bytes = loaded.bytes.len();
            Ok((loaded, bytes))
        };
        read(scratch.part((self.key, episode), make)?)
    }
}

/// The values of a feature, of all episodes end to end.
#[derive(Debug)]
pub(super) struct Values {
    episodes: Arc<Episodes>,
    feature: String,
    dtype: Dtype,
    shape: Vec<usize>,
    is_image: bool,
    /// Whether each episode has one value.
    is_of_episode: bool,
    key: usize,
}

impl Values {
    /// The values of a feature; the inner error says why it becomes no column.
    pub(super) fn new(
        episodes: &Arc<Episodes>,
        feature: &Feature,
        kind: FieldKind,
        scratch: &mut Scratch,
    ) -> Result<Result<Self, String>> {
        let (dtype, shape, is_image) = match &feature.kind {
            Kind::Numbers { dtype, shape } => (*dtype, shape.clone(), false),
            Kind::Text => (Dtype::Str, Vec::new(), false),
            Kind::Image { shape } => {
                let first = episodes.lengths.iter().position(|&length| length > 0);
                let shape = match (shape, first) {
                    (Some(shape), _) => *shape,
                    (None, None) => return Ok(Err("it has no images".to_owned())),
                    (None, Some(episode)) => {
                        let shape = episodes.with(episode, scratch, |loaded| {
                            loaded.texts(&feature.key)?.first().map(|image| shape_of(image)).transpose()
                        });
                        match shape {
                            Ok(Some(shape)) => shape,
                            Ok(None) => return Ok(Err("it has no images".to_owned())),
                            Err(error) => return Ok(Err(error.to_string())),
                        }
                    }
                };
                (Dtype::U8, shape.to_vec(), true)
            }
            Kind::Skipped(reason) => return Ok(Err(reason.clone())),
        };
        let is_of_episode = kind == FieldKind::Episode;
        if is_of_episode && is_image {
            return Ok(Err(format!(
                "it is one image for an episode, which {NAME} columns are not read from"
            )));
        }
        let (feature, episodes) = (feature.key.clone(), episodes.clone());
        Ok(Ok(Self { episodes, feature, dtype, shape, is_image, is_of_episode, key: new_key() }))
    }

    /// All values of an episode.
    fn decoded(&self, episode: usize, scratch: &mut Scratch) -> Result<Column> {
        let rows = if self.is_of_episode { 1 } else { self.episodes.lengths[episode] };
        let (dtype, name) = (self.dtype, self.feature.as_str());
        let column = self.episodes.with(episode, scratch, |loaded| {
            let column = if dtype == Dtype::Str {
                let text = |bytes: &[u8]| {
                    String::from_utf8(bytes.to_vec()).map_err(|_| invalid("a text is not UTF-8"))
                };
                Column::Str(loaded.texts(name)?.into_iter().map(text).collect::<Result<_>>()?)
            } else if let (Dtype::I64, List::Integers(range)) = (dtype, loaded.list(name)?) {
                Column::I64(integers(&loaded.bytes[range.clone()])?)
            } else {
                let mut numbers = loaded.numbers(name)?;
                // An end of the recording is not one of the task.
                if name == LAST && loaded.lists.contains_key(TERMINAL) {
                    let ends = loaded.numbers(TERMINAL)?;
                    numbers
                        .iter_mut()
                        .zip(ends)
                        .filter(|(_, end)| *end != 0.0)
                        .for_each(|(last, _)| *last = 0.0);
                }
                cast(&numbers, dtype)?
            };
            Ok(column)
        })?;
        match column.len() == rows * self.dim() {
            true => Ok(column),
            false => Err(invalid(format!(
                "`{name}` has {} values in episode {episode}, and {rows} rows of {:?}",
                column.len(),
                self.shape
            ))),
        }
    }
}

/// Numbers as they are in columns.
fn cast(numbers: &[f64], dtype: Dtype) -> Result<Column> {
    let whole = |low: f64, high: f64| match numbers.iter().find(|value| !(low..=high).contains(*value)) {
        Some(value) => Err(invalid(format!("the value {value} is none of its type, {dtype}"))),
        None => Ok(()),
    };
    Ok(match dtype {
        Dtype::Bool => Column::Bool(numbers.iter().map(|&value| value != 0.0).collect()),
        Dtype::U8 => {
            whole(0.0, 255.0)?;
            Column::U8(numbers.iter().map(|&value| value as u8).collect())
        }
        Dtype::I32 => {
            whole(f64::from(i32::MIN), f64::from(i32::MAX))?;
            Column::I32(numbers.iter().map(|&value| value as i32).collect())
        }
        Dtype::I64 => Column::I64(numbers.iter().map(|&value| value as i64).collect()),
        Dtype::F32 => Column::F32(numbers.iter().map(|&value| value as f32).collect()),
        Dtype::F64 => Column::F64(numbers.to_vec()),
        Dtype::Str => return Err(wrong_type("texts are no numbers")),
    })
}

/// The shape of an image of PNG or JPEG.
fn shape_of(image: &[u8]) -> Result<[usize; 3]> {
    if image.starts_with(&[0xff, 0xd8]) {
        return jpeg::shape(image).map_err(FormatError::other);
    }
    // A PNG file begins with its signature and the chunk IHDR: width, height, bits, kind of colors.
    let head: Option<&[u8; 26]> = image.first_chunk();
    let head = head
        .filter(|head| head.starts_with(b"\x89PNG"))
        .ok_or_else(|| unsupported("its images are neither PNG nor JPEG"))?;
    let size = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let colors = if head[25] == 0 { 1 } else { 3 };
    match (size(20), size(16)) {
        (height @ 1..=0xffff, width @ 1..=0xffff) => Ok([height, width, colors]),
        (height, width) => Err(invalid(format!("an image claims {height} × {width} pixels"))),
    }
}

impl Array for Values {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn rows(&self) -> usize {
        self.episodes.ends.last().copied().unwrap_or(0)
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let dim = self.dim();
        for index in 0..rows.count {
            let row = rows.first + index * rows.stride;
            let episode = self.episodes.ends.partition_point(|&end| end <= row);
            let first = episode.checked_sub(1).map_or(0, |before| self.episodes.ends[before]);
            let at = if self.is_of_episode { 0 } else { row - first };
            let (mut one, rest) = out.split_at(dim);
            out = rest;
            if self.is_image {
                let SliceMut::U8(out) = one else { return Err(wrong_type("images hold bytes")) };
                let shape = [self.shape[0], self.shape[1], self.shape[2]];
                self.episodes.with(episode, scratch, |loaded| {
                    let images = loaded.texts(&self.feature)?;
                    let image = images.get(at).ok_or_else(|| missing(format!("row {at} has no image")))?;
                    match image {
                        [0xff, 0xd8, ..] => jpeg::decode_into(image, shape, out)?,
                        image => png::decode_into(image, shape, out)?,
                    }
                    Ok(())
                })?;
                continue;
            }
            let make = |scratch: &mut Scratch| {
                let column = self.decoded(episode, scratch)?;
                let bytes = column.len() * 8;
                Ok((column, bytes))
            };
            let column = scratch.part((self.key, episode), make)?;
            copy_rows(column.as_slice(), dim, Steps { first: at, count: 1, stride: 1 }, one.reborrow());
        }
        Ok(())
    }
}
