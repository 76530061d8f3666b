//! Lance tables, the default format of the reference: a row for each step, with the number of its episode; and beside them
//! `NAME_episodes.lance`, with a row for each episode. The crate `swm_lance` reads the files.
//!
//! Source of the layout: stable-worldmodel addbab4, `data/formats/lance.py`.

mod column;
mod lerobot;
mod place;
mod spread;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;
use swm_core::{Column as Values, Field, FieldKind};
use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, Steps};
use swm_data::episodes::{StepNumbers, TableEpisodes};
use swm_data::error::{At as _, DataError, FormatError, Result, invalid, missing, unsupported};
use swm_data::foreign::lerobot_info;
use swm_lance::{Column, Cursor, Kind, LanceError, Table};

use self::column::TableColumn;
use self::place::Place;
use self::spread::Spread;
use super::array::{Memory, Scratch, Shared, values};
use super::dataset::Span;
use super::found::{Found, Source};

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
    if let Some(info) = lerobot_info(path) {
        lerobot::name(&info, &mut found);
    }
    found.open(path, NAME, options, &[])
}

fn find(place: &Place, table: &Arc<Table>, [episode, step]: &[&str; 2]) -> Result<Found> {
    let has_rewards_of_arrival = *episode == INDICES[0][0];
    let mut found = Found { has_rewards_of_arrival, ..Found::default() };
    let mut episodes = episodes(table, [episode, step]).at(format_args!("column `{episode}`"))?;
    let steps = counted(table, step, &episodes.lengths).at(format_args!("column `{step}`"))?;
    found.notes.extend(episodes.divide(&steps.gaps));
    let TableEpisodes { lengths, numbers } = episodes;
    found.lengths = lengths;
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
fn each_block(table: &Table, column: &Column, take: &mut dyn FnMut(&[i64]) -> Result<()>) -> Result<()> {
    let mut cursor = Cursor::default();
    let mut first = 0;
    while first < table.rows() {
        let count = (table.rows() - first).min(BLOCK as u64);
        let values = table.read(column, first, count as usize, &mut cursor).map_err(of_lance)?;
        if !values.is_complete() {
            return Err(invalid("some of its numbers are missing"));
        }
        take(&column::integers(&column.kind, values.numbers())?)?;
        first += count;
    }
    Ok(())
}

/// The episodes of a table.
fn episodes(table: &Table, names: [&str; 2]) -> Result<TableEpisodes> {
    match table.column(names[0]) {
        Some(column) => TableEpisodes::of(names, &|take| each_block(table, column, take)),
        None => Ok(TableEpisodes::default()),
    }
}

/// Gaps in episodes of these lengths, by the column of the numbers of rows.
fn counted(table: &Table, name: &str, lengths: &[usize]) -> Result<StepNumbers> {
    let behind = table.gaps().filter_map(|row| usize::try_from(row).ok()).collect();
    let Some(column) = table.column(name) else {
        return Ok(StepNumbers { is_index: true, ..StepNumbers::of(lengths, behind, None)? });
    };
    let read = |take: &mut dyn FnMut(&[i64]) -> Result<()>| each_block(table, column, take);
    let is_integer = matches!(column.kind, Kind::Int { .. });
    StepNumbers::of(lengths, behind, is_integer.then_some(&read as _))
}

/// Adds the columns of the table of episodes.
fn of_episodes(place: &Place, name: &str, numbers: &[i64], found: &mut Found) -> Result<()> {
    let table = Arc::new(place.table()?);
    let (mut theirs, mut row) = (BTreeMap::new(), 0);
    if let Some(column) = table.column(name) {
        each_block(&table, column, &mut |block| {
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
    let lists = table.read(column, 0, rows, &mut Cursor::default()).map_err(of_lance)?;
    let width = if rows == 0 { 0 } else { lists.items(0).len() };
    if width == 0 || !lists.is_complete() || (0..rows).any(|row| lists.items(row).len() != width) {
        return Err(unsupported("its lists are of several lengths, empty or missing"));
    }
    let mut all = Values::zeros(element.dtype(), rows * width);
    swm_data::element::from_bytes(element, lists.numbers(), all.as_slice_mut())?;
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

/// An error of a table as one of a format.
fn of_lance(error: LanceError) -> FormatError {
    match error {
        // The network may be what failed.
        LanceError::Io(error) => FormatError::Io(error),
        LanceError::At { place, source } => of_lance(*source).at(place),
        LanceError::Unsupported(reason) => unsupported(reason),
        error => FormatError::other(error),
    }
}
