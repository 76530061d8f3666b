//! Texts of tasks by their numbers, which the column `task_index` has: `meta/tasks.parquet` of version 3, `meta/tasks.jsonl` of version 2.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::Column;

use super::info::{Info, Version};
use super::table::Table;
use crate::error::{At as _, FormatError, Result, missing};
use crate::formats::disk::read_regular;

/// The column of a row's task.
pub(super) const TASK_INDEX: &str = "task_index";
/// Names of the column of texts: LeRobot's, and that of an index of pandas without a name.
const TEXTS: [&str; 2] = ["task", "__index_level_0__"];

/// All tasks.
pub(super) fn read(path: &Path, info: &Info) -> Result<BTreeMap<i64, String>> {
    match info.version()? {
        Version::V2 => lines(&path.join("meta/tasks.jsonl")),
        Version::V3 => rows(&path.join("meta/tasks.parquet")),
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
