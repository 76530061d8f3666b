//! Texts of tasks by their numbers, which the column `task_index` has: `meta/tasks.parquet` of version 3, `meta/tasks.jsonl` of version 2.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::{Column, Slice};

use super::info::{Info, Version};
use super::parquet_file::{self, ColumnOut};
use super::table::Table;
use crate::error::{At as _, DataError, FormatError, Result, missing};
use crate::formats::disk::{read_regular, replace};

/// Where those of version 3 are.
const FILE: &str = "meta/tasks.parquet";
/// The column of a row's task.
pub(super) const TASK_INDEX: &str = "task_index";
/// Names of the column of texts: LeRobot's, and that of an index of pandas without a name.
const TEXTS: [&str; 2] = ["task", "__index_level_0__"];

/// All tasks.
pub(super) fn read(path: &Path, info: &Info) -> Result<BTreeMap<i64, String>> {
    match info.version()? {
        Version::V2 => lines(&path.join("meta/tasks.jsonl")),
        Version::V3 => rows(&path.join(FILE)),
    }
}

fn lines(path: &Path) -> Result<BTreeMap<i64, String>> {
    let text = String::from_utf8(read_regular(path).at(path.display())?).map_err(FormatError::other)?;
    let mut tasks = BTreeMap::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let entry: Json = serde_json::from_str(line).at(path.display())?;
        let (Some(number), Some(task)) = (entry[TASK_INDEX].as_i64(), entry["task"].as_str()) else {
            return Err(missing("a task without number or text")).at(path.display());
        };
        tasks.insert(number, task.to_owned());
    }
    Ok(tasks)
}

/// Those of a folder of ours, which may have none yet.
pub(super) fn of_ours(path: &Path) -> Result<BTreeMap<i64, String>> {
    let path = path.join(FILE);
    if path.is_file() { rows(&path) } else { Ok(BTreeMap::new()) }
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
    replace(&path, &bytes).map_err(|source| DataError::io(&path, "write", source))
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
    let numbers = table.integers(TASK_INDEX);
    let texts = TEXTS.iter().find_map(|name| match table.column(name) {
        Ok(Column::Str(texts)) if texts.len() == table.rows() => Some(texts),
        _ => None,
    });
    match (numbers, texts) {
        (Some(numbers), Some(texts)) => Ok(numbers.into_iter().zip(texts).collect()),
        _ => Err(missing("it has no numbers and texts of tasks")).at(path.display()),
    }
}
