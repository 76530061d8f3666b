//! Columns of the values of records.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use swm_core::{Column, Dtype, FieldKind, SliceMut};
use swm_data::dataset::{Steps, copy_rows};
use swm_data::element::NOT_UTF8;
use swm_data::error::{At as _, Result, invalid, missing, unsupported, wrong_type};

use super::example::{Entry, List, Lists, floats, integers, lists, scan, texts};
use super::features::{Feature, Kind};
use super::records::Record;
use super::{NAME, STEPS};
use crate::array::{Array, Scratch, new_key};
use crate::encoded;

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
    /// By key, the episodes that have no values of it.
    lacking: BTreeMap<String, BTreeSet<usize>>,
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

/// How many values a key of a record has, and the keys that have some.
fn contents(record: &Record, counted: &str) -> Result<(usize, BTreeSet<String>)> {
    let read = |out: &mut [u8], at| record.part(out, at).is_ok();
    let count = |entries: &[Entry]| {
        let entry = entries.iter().find(|entry| entry.key == counted)?;
        let Some((number, from, size)) = entry.list else { return Some(0) };
        let mut list = vec![0; usize::try_from(size).ok()?];
        match number {
            _ if !read(&mut list, from) => None,
            1 => texts(&list).ok().map(|texts| texts.len()),
            2 => floats(&list).ok().map(|floats| floats.len()),
            3 => integers(&list).ok().map(|integers| integers.len()),
            _ => None,
        }
    };
    if let Some(entries) = scan(record.length(), &read)
        && let Some(count) = count(&entries)
    {
        let keys = entries.into_iter().filter(|entry| entry.list.is_some()).map(|entry| entry.key);
        return Ok((count, keys.collect()));
    }
    // What is not where it usually is, is looked for in all of the record.
    let loaded = Loaded::read(record)?;
    let has_values = |list: &List| match list {
        List::Bytes(range) | List::Floats(range) | List::Integers(range) => !range.is_empty(),
        List::None => false,
    };
    let keys = loaded.lists.iter().filter(|(_, list)| has_values(list)).map(|(key, _)| key.clone());
    Ok((loaded.count(counted)?, keys.collect()))
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
        let (mut lengths, mut lacking) = (Vec::with_capacity(records.len()), BTreeMap::new());
        for (episode, record) in records.iter().enumerate() {
            let (count, keys) = contents(record, &counted.key).at(format_args!("episode {episode}"))?;
            lengths.push(count / each);
            for feature in features.iter().filter(|feature| !keys.contains(&feature.key)) {
                lacking.entry(feature.key.clone()).or_insert_with(BTreeSet::new).insert(episode);
            }
        }
        let mut end = 0;
        let ends = lengths.iter().map(|length| {
            end += length;
            end
        });
        Ok(Self { ends: ends.collect(), lengths, records, lacking, key: new_key() })
    }

    /// Whether an episode has values of a key.
    pub(super) fn has(&self, episode: usize, key: &str) -> bool {
        self.lacking.get(key).is_none_or(|episodes| !episodes.contains(&episode))
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
                let has_some =
                    |&episode: &usize| episodes.lengths[episode] > 0 && episodes.has(episode, &feature.key);
                let first = (0..episodes.lengths.len()).find(has_some);
                let shape = match (shape, first) {
                    (Some(shape), _) => *shape,
                    (None, None) => return Ok(Err("it has no images".to_owned())),
                    (None, Some(episode)) => {
                        let shape = episodes.with(episode, scratch, |loaded| {
                            loaded.texts(&feature.key)?.first().map(|image| encoded::shape(image)).transpose()
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
                let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).map_err(|_| invalid(NOT_UTF8));
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
                    encoded::decode(image, shape, out)
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
