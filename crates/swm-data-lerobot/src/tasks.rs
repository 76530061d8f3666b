//! Texts of tasks by their numbers, which the column `task_index` has: `meta/tasks.parquet` of version 3, `meta/tasks.jsonl` of version 2.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::Slice;
use swm_data::error::{At as _, DataError, FormatError, Result, invalid, missing};
use swm_files::{read_regular, replace_unsynced};

use super::info::Version;
use super::parquet_file::{self, ColumnOut};
use super::table::Table;

/// Where those of version 3 are.
const FILE: &str = "meta/tasks.parquet";
/// The column of a row's task.
pub(super) const TASK_INDEX: &str = "task_index";
/// Names of the column of texts: LeRobot's, and that of an index of pandas without a name.
const TEXTS: [&str; 2] = ["task", "__index_level_0__"];

/// The list of tasks in a folder.
pub(super) fn file(version: Version) -> &'static str {
    match version {
        Version::V2 => "meta/tasks.jsonl",
        Version::V3 => FILE,
    }
}

/// All tasks.
///
/// # Errors
///
/// The list is not there, is damaged, or contradicts itself.
pub(super) fn read(path: &Path, version: Version) -> Result<BTreeMap<i64, String>> {
    let list = path.join(file(version));
    match version {
        Version::V2 => lines(&list),
        Version::V3 => rows(&list),
    }
    .at(format_args!("`{}`", file(version)))
}

/// The text of the task of a row.
pub(super) fn text(texts: &BTreeMap<i64, String>, number: i64, row: usize) -> Result<&String> {
    texts.get(&number).ok_or_else(|| {
        missing(format!(
            "there is no task {number}, which the `{TASK_INDEX}` of row {row} names; add its text to the list of tasks, or correct the row"
        ))
    })
}

/// Texts by their numbers.
fn numbered(tasks: impl IntoIterator<Item = (i64, String)>) -> Result<BTreeMap<i64, String>> {
    let mut texts: BTreeMap<i64, String> = BTreeMap::new();
    for (number, text) in tasks {
        if number < 0 {
            return Err(invalid(format!(
                "the task `{text}` has the number {number}, and numbers begin with 0; give it another, in its rows, too"
            )));
        }
        if let Some(other) = texts.get(&number).filter(|other| **other != text) {
            return Err(invalid(format!(
                "the number {number} is that of two tasks, `{other}` and `{text}`; give one of them another, in its rows, too"
            )));
        }
        texts.insert(number, text);
    }
    Ok(texts)
}

fn lines(path: &Path) -> Result<BTreeMap<i64, String>> {
    let text = String::from_utf8(read_regular(path)?).map_err(FormatError::other)?;
    let mut tasks = Vec::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let entry: Json = serde_json::from_str(line)?;
        let (Some(number), Some(task)) = (entry[TASK_INDEX].as_i64(), entry["task"].as_str()) else {
            return Err(missing("a task without number or text"));
        };
        tasks.push((number, task.to_owned()));
    }
    numbered(tasks)
}

/// Those of a folder of ours, which may have none yet.
pub(super) fn of_ours(path: &Path) -> Result<BTreeMap<i64, String>> {
    let list = path.join(FILE);
    if list.is_file() { rows(&list).at(format_args!("`{FILE}`")) } else { Ok(BTreeMap::new()) }
}

/// Writes `meta/tasks.parquet`: numbers of tasks, by their texts, which pandas takes for the index.
pub(super) fn write(folder: &Path, tasks: &[String]) -> Result<(), DataError> {
    let path = folder.join(FILE);
    let pandas = serde_json::json!({
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": null},
            {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": null},
        ],
    });
    let numbers: Vec<i64> = (0..tasks.len() as i64).collect();
    let columns =
        [ColumnOut::scalar("task_index", Slice::I64(&numbers)), ColumnOut::scalar("task", Slice::Str(tasks))];
    let bytes = parquet_file::bytes(&columns, &[("pandas", pandas.to_string())])
        .map_err(|error| DataError::record(&path, error))?;
    replace_unsynced(&path, &bytes).map_err(|source| DataError::io(&path, "write", source))
}

/// Most tasks of an episode that the list of episodes names; the tables have all.
const MAX_NAMED: usize = 16;

/// The first tasks of an episode, by the numbers of its rows.
pub(super) fn named(texts: &BTreeMap<i64, String>, numbers: &[i64]) -> Result<Vec<String>> {
    let mut seen: Vec<i64> = Vec::new();
    for number in numbers {
        if seen.len() < MAX_NAMED && !seen.contains(number) {
            seen.push(*number);
        }
    }
    let text = |number| texts.get(&number).ok_or_else(|| missing(format!("there is no task {number}")));
    seen.into_iter().map(|number| text(number).cloned()).collect()
}

/// The tasks of a folder that is being recorded. LeRobot finds a text by its place in the list, so numbers have no gaps.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    texts: Vec<String>,
    numbers: BTreeMap<String, i64>,
    /// How many of them are on the disk.
    written: usize,
    /// Those of the open episode.
    own: Vec<String>,
}

impl Recorded {
    pub(super) fn new(texts: BTreeMap<i64, String>) -> Self {
        let texts: Vec<String> = texts.into_values().collect();
        let numbers = texts.iter().cloned().zip(0..).collect();
        Self { written: texts.len(), texts, numbers, own: Vec::new() }
    }

    pub(super) fn count(&self) -> usize {
        self.texts.len()
    }

    /// The number of a task of the open episode.
    pub(super) fn number(&mut self, text: &str) -> i64 {
        if self.own.len() < MAX_NAMED && self.own.iter().all(|task| task != text) {
            self.own.push(text.to_owned());
        }
        if let Some(&number) = self.numbers.get(text) {
            return number;
        }
        let number = self.texts.len() as i64;
        self.texts.push(text.to_owned());
        self.numbers.insert(text.to_owned(), number);
        number
    }

    /// Writes the list if the open episode has new ones. Those of the episode, which ends.
    pub(super) fn end_episode(&mut self, folder: &Path) -> Result<Vec<String>, DataError> {
        if self.texts.len() > self.written {
            write(folder, &self.texts)?;
            self.written = self.texts.len();
        }
        Ok(std::mem::take(&mut self.own))
    }
}

fn rows(path: &Path) -> Result<BTreeMap<i64, String>> {
    let table = Table::open(path)?;
    let mut texts = None;
    for name in TEXTS {
        texts = texts.or(table.texts(name)?);
    }
    match (table.integers(TASK_INDEX)?, texts) {
        (Some(numbers), Some(texts)) => numbered(numbers.into_iter().zip(texts)),
        _ => Err(missing(format!("it has no numbers (`{TASK_INDEX}`) and texts (`task`) of tasks"))),
    }
}
