//! Lance tables, the default format of the reference: a row for each step, with the number of its episode; and beside them
//! `NAME_episodes.lance`, with a row for each episode. The crate `swm_lance` reads the files.
//!
//! Source of the layout: stable-worldmodel addbab4, `data/formats/lance.py`.

mod column;
mod lerobot;
mod place;
mod spread;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;
use swm_core::{Column as Values, Field, FieldKind};
use swm_lance::{Column, Cursor, Kind, LanceError, Table};

#[cfg(feature = "lerobot")]
pub(crate) use self::lerobot::{NAMES, is_native};

use self::column::TableColumn;
use self::place::Place;
use self::spread::Spread;
use super::array::{Memory, Scratch, Shared, values};
use super::dataset::Span;
use super::found::{Found, Source};
use crate::dataset::{Dataset, Steps};
use crate::error::{At as _, DataError, FormatError, Result, invalid, missing, unsupported};
use crate::open_options::OpenOptions;

const NAME: &str = "lance";
/// The columns with the number of the episode and of the row in it: of the reference, and of LeRobot's frames.
const INDICES: [[&str; 2]; 2] = [["episode_idx", "step_idx"], ["episode_index", "frame_index"]];
/// Rows of these that are read at once.
const BLOCK: usize = 1 << 16;
/// What follows the name of a table in those beside it.
const EPISODES: &str = "_episodes.lance";
const VIDEOS: &str = "_videos.lance";
/// The record in tables that this package wrote.
const RECORD: &str = "swm";

pub(super) fn detect(path: &Path) -> bool {
    Place::of(path).is_some()
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let damaged = |error: FormatError| DataError::damaged(path, error);
    let place = Place::of(path).ok_or_else(|| damaged(missing("it has no manifest")))?;
    let table = Arc::new(place.table().map_err(damaged)?);
    let Some(indices) = INDICES.iter().find(|[episode, _]| table.column(episode).is_some()) else {
        let reason = "it is a Lance table without `episode_idx`, which has the episode of each row in the tables of stable-worldmodel";
        return Err(DataError::not_a_dataset(path, reason));
    };
    let mut found = find(&place, &table, indices).map_err(damaged)?;
    if let Some(info) = lerobot::info(path) {
        lerobot::name(&info, &mut found);
    }
    found.open(path, NAME, options, &[])
}

fn find(place: &Place, table: &Arc<Table>, [episode, step]: &[&str; 2]) -> Result<Found> {
    let has_rewards_of_arrival = *episode == INDICES[0][0];
    let mut found = Found { has_rewards_of_arrival, ..Found::default() };
    let mut numbers =
        episodes(table, [episode, step], &mut found.lengths).at(format_args!("column `{episode}`"))?;
    let steps = Counted::of(table, step, &found.lengths).at(format_args!("column `{step}`"))?;
    found.split(&mut numbers, &steps.gaps);
    if table.deleted() > 0 {
        found.notes.push(format!("{} of its rows are deleted, and not read", table.deleted()));
    }
    let record = Record::of(table)?;
    let mut known = vec![*episode];
    known.extend(steps.is_index.then_some(*step));
    match &record {
        Some(record) => found.recorded(place, table, record)?,
        None => {
            let spans = found.end_to_end();
            for column in table.columns().iter().filter(|column| !known.contains(&column.name.as_str())) {
                let array = TableColumn::of(table, column).and_then(readable);
                found.add(&column.name, FieldKind::Step, array, &spans)?;
            }
        }
    }
    if let Some(beside) = place.beside(EPISODES)? {
        let rows = of_episodes(&beside, episode, &numbers, &mut found);
        rows.at(format_args!("the table of episodes, {beside}"))?;
    }
    Ok(found)
}

impl Found {
    /// Divides episodes in front of these rows: what is missing there would be a transition that never was.
    fn split(&mut self, numbers: &mut Vec<i64>, gaps: &[usize]) {
        let whole = self.lengths.len();
        let mut gaps = gaps.iter().peekable();
        let (mut parts, mut part_numbers, mut first) = (Vec::new(), Vec::new(), 0);
        for (length, &number) in std::mem::take(&mut self.lengths).into_iter().zip(&*numbers) {
            let end = first + length;
            while let Some(gap) = gaps.next_if(|&&gap| gap < end) {
                parts.push(gap - first);
                part_numbers.push(number);
                first = *gap;
            }
            parts.push(end - first);
            part_numbers.push(number);
            first = end;
        }
        if parts.len() > whole {
            self.notes.push(format!(
                "rows are missing amid its {whole} episodes; what is before and behind is apart, so that they are {}",
                parts.len()
            ));
        }
        (self.lengths, *numbers) = (parts, part_numbers);
    }

    /// Adds a column, or the reason why there is none.
    fn add(&mut self, name: &str, kind: FieldKind, array: Result<Shared>, spans: &[Span]) -> Result<()> {
        match array {
            Ok(array) => {
                let source = Source::step(name, name, vec![array], spans.to_vec());
                self.sources.push(Source { kind, ..source });
                Ok(())
            }
            Err(error) if error.is_unsupported() => {
                self.skipped.push((name.to_owned(), error.to_string()));
                Ok(())
            }
            Err(error) => Err(error.at(format_args!("column `{name}`"))),
        }
    }

    /// The columns as this package recorded them.
    fn recorded(&mut self, place: &Place, table: &Arc<Table>, record: &Record) -> Result<()> {
        let spans = self.end_to_end();
        for (field, name) in record.columns.iter().zip(record.names()) {
            match table.column(&name) {
                Some(column) => {
                    let array = TableColumn::recorded(table, column, field).and_then(readable);
                    self.add(&field.name, field.kind, array, &spans)?;
                }
                None if place.beside(VIDEOS)?.is_some() => {
                    let reason = "its images are videos of the table `_videos` beside it, which builds with the feature `lance` read";
                    self.skipped.push((field.name.clone(), reason.to_owned()));
                }
                None => return Err(invalid(format!("it has no column `{name}`"))),
            }
        }
        self.notes.push(
            "this package recorded the table; builds with the feature `lance` also read the settings of its runs, and its checksums"
                .to_owned(),
        );
        Ok(())
    }
}

/// A column whose first row can be read.
fn readable(column: TableColumn) -> Result<Shared> {
    let array: Shared = Arc::new(column);
    if array.rows() > 0 {
        values(array.as_ref(), Steps { first: 0, count: 1, stride: 1 }, &mut Scratch::default())?;
    }
    Ok(array)
}

/// The integers of a column, in blocks.
fn each_block(table: &Table, column: &Column, mut take: impl FnMut(&[i64]) -> Result<()>) -> Result<()> {
    let mut cursor = Cursor::default();
    let mut first = 0;
    while first < table.rows() {
        let count = (table.rows() - first).min(BLOCK as u64);
        let values = table.read(column, first, count as usize, &mut cursor)?;
        if !values.is_complete() {
            return Err(invalid("some of its numbers are missing"));
        }
        take(&column::integers(&column.kind, values.numbers())?)?;
        first += count;
    }
    Ok(())
}

/// The lengths of the episodes, and their numbers in the table.
fn episodes(table: &Table, [name, step]: [&str; 2], lengths: &mut Vec<usize>) -> Result<Vec<i64>> {
    let mut numbers: Vec<i64> = Vec::new();
    let Some(column) = table.column(name) else { return Ok(numbers) };
    each_block(table, column, |block| {
        for &number in block {
            match (numbers.last(), lengths.last_mut()) {
                (Some(&last), Some(length)) if last == number => *length += 1,
                (Some(&last), _) if last > number => {
                    return Err(unsupported(format!(
                        "episode {number} follows episode {last}, and should be before it, as after updates of a table; write it sorted in \
                         Python, with lance.write_dataset(lance.dataset(OLD).to_table().sort_by([(\"{name}\", \"ascending\"), \
                         (\"{step}\", \"ascending\")]), NEW)"
                    )));
                }
                _ => {
                    numbers.push(number);
                    lengths.push(1);
                }
            }
        }
        Ok(())
    })?;
    Ok(numbers)
}

/// What the column with the number of each row in its episode shows.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counted {
    /// Whether it only counts the rows of each episode, or is not there.
    is_index: bool,
    /// Rows of the table, none of them the first of an episode, in front of which some are missing: the number grows by more than
    /// elsewhere, or by more than 1 over deleted rows. Where nothing is counted, those behind deleted rows.
    gaps: Vec<usize>,
}

impl Counted {
    fn of(table: &Table, name: &str, lengths: &[usize]) -> Result<Self> {
        let column = table.column(name);
        let mut behind: BTreeSet<usize> = table.gaps().filter_map(|row| usize::try_from(row).ok()).collect();
        if let Some(column) = column.filter(|column| matches!(column.kind, Kind::Int { .. })) {
            let (mut steps, mut is_index) = (Growth::of(lengths), true);
            let mut least = i64::MAX;
            let read = each_block(table, column, |block| {
                for &number in block {
                    let grown = steps.next(number);
                    is_index &= grown.map_or(number == 0, |grown| grown == 1);
                    least = least.min(grown.unwrap_or(i64::MAX));
                }
                Ok(())
            });
            match read {
                Err(error) if error.is_unsupported() => {}
                Err(error) => return Err(error),
                Ok(()) if is_index => return Ok(Self { is_index, gaps: Vec::new() }),
                Ok(()) if least > 0 => {
                    let (mut steps, mut row, mut gaps) = (Growth::of(lengths), 0, Vec::new());
                    each_block(table, column, |block| {
                        for &number in block {
                            let is_gap = |&grown: &i64| grown > least || grown > 1 && behind.contains(&row);
                            gaps.extend(steps.next(number).filter(is_gap).map(|_| row));
                            row += 1;
                        }
                        Ok(())
                    })?;
                    return Ok(Self { is_index, gaps });
                }
                Ok(()) => {}
            }
        }
        let mut first = 0;
        for length in lengths {
            behind.remove(&first);
            first += length;
        }
        Ok(Self { is_index: column.is_none(), gaps: behind.into_iter().collect() })
    }
}

/// By how much a number grows from row to row of an episode.
struct Growth<'a> {
    lengths: std::slice::Iter<'a, usize>,
    /// Rows of the episode that are left, and the number of the last one.
    left: usize,
    last: i64,
}

impl<'a> Growth<'a> {
    fn of(lengths: &'a [usize]) -> Self {
        Self { lengths: lengths.iter(), left: 0, last: 0 }
    }

    /// `None` for the first row of an episode.
    fn next(&mut self, number: i64) -> Option<i64> {
        let last = std::mem::replace(&mut self.last, number);
        if self.left > 0 {
            self.left -= 1;
            return Some(number.saturating_sub(last));
        }
        self.left = self.lengths.next().map_or(0, |length| length - 1);
        None
    }
}

/// Adds the columns of the table of episodes.
fn of_episodes(place: &Place, name: &str, numbers: &[i64], found: &mut Found) -> Result<()> {
    let table = Arc::new(place.table()?);
    let (mut theirs, mut row) = (BTreeMap::new(), 0);
    if let Some(column) = table.column(name) {
        each_block(&table, column, |block| {
            for &number in block {
                theirs.entry(number).or_insert(row);
                row += 1;
            }
            Ok(())
        })?;
    }
    let rows: Arc<[Option<usize>]> = numbers.iter().map(|number| theirs.get(number).copied()).collect();
    let spans = found.end_to_end();
    let ends: Arc<[usize]> = spans.iter().map(|span| span.first + span.count).collect();
    for column in table.columns().iter().filter(|column| column.name != name) {
        let array = match &column.kind {
            Kind::List(_) => lists(&table, column),
            _ => TableColumn::of(&table, column).and_then(readable),
        };
        let array = array.map(|values| Spread::of(values, &rows, &ends));
        found.add(&column.name, FieldKind::Episode, array, &spans)?;
    }
    Ok(())
}

/// Lists of one length as vectors in memory.
fn lists(table: &Arc<Table>, column: &Column) -> Result<Shared> {
    let Kind::List(item) = &column.kind else { return Err(unsupported("it has no lists")) };
    let Some(element) = column::element(item) else {
        return Err(unsupported(format!("its lists are of {item}")));
    };
    let rows = usize::try_from(table.rows()).ok().filter(|&rows| rows <= MAX_EPISODES);
    let rows = rows.ok_or_else(|| invalid("it has too many rows"))?;
    let lists = table.read(column, 0, rows, &mut Cursor::default())?;
    let width = if rows == 0 { 0 } else { lists.items(0).len() };
    if width == 0 || !lists.is_complete() || (0..rows).any(|row| lists.items(row).len() != width) {
        return Err(unsupported("its lists are of several lengths, empty or missing"));
    }
    let mut all = Values::zeros(element.dtype(), rows * width);
    crate::formats::element::from_bytes(element, lists.numbers(), all.as_slice_mut())?;
    Ok(Memory::of(all, &[width]))
}

/// Rows of a table of episodes, at most, whose lists are kept.
const MAX_EPISODES: usize = 1 << 22;

/// The record in tables of this package: their columns.
#[derive(Deserialize)]
struct Record {
    version: u32,
    columns: Vec<Field>,
}

impl Record {
    fn of(table: &Table) -> Result<Option<Self>> {
        let Some(text) = table.metadata().get(RECORD) else { return Ok(None) };
        let record: Self = serde_json::from_str(text).at("its record")?;
        match record.version {
            1 => Ok(Some(record)),
            version => Err(unsupported(format!("its record has the version {version}, and 1 is read"))),
        }
    }

    /// The names in the table: without dots, and each once.
    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for field in &self.columns {
            let mut name = field.name.replace('.', "_");
            while INDICES[0].contains(&name.as_str()) || names.contains(&name) {
                name.push('_');
            }
            names.push(name);
        }
        names
    }
}

impl From<LanceError> for FormatError {
    fn from(error: LanceError) -> Self {
        match error {
            // The network may be what failed.
            LanceError::Io(error) => Self::Io(error),
            LanceError::At { place, source } => Self::from(*source).at(place),
            LanceError::Unsupported(reason) => unsupported(reason),
            error => Self::other(error),
        }
    }
}
