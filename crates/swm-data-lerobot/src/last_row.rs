//! The last row of an episode, which no action follows. LeRobot trains on every row of a table, and takes chunks of actions that end
//! there, so it is beside the tables: `meta/swm-last/` has a table of one row for each episode that has such a row. Its images are the
//! last frames of the episode's videos, which LeRobot never asks for, as no row has their time.

use std::path::Path;

use swm_core::{Batch, Slice};
use swm_data::error::{At as _, Result, wrong_type};
use swm_files::replace_unsynced;

use super::episodes::CHUNK;
use super::manifest::ACTION;
use super::parquet_file::{self, ColumnOut};

/// `meta/swm-last/chunk-000/file-017.parquet`.
pub(super) fn path_of(episode: usize) -> String {
    format!("meta/swm-last/chunk-{:03}/file-{:03}.parquet", episode / CHUNK, episode % CHUNK)
}

/// Writes the row, and gives the checksum of its file.
pub(super) fn write(path: &Path, columns: &[ColumnOut<'_>]) -> Result<u32> {
    let bytes = parquet_file::bytes(columns, &[])?;
    let parent = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    parent.and_then(|()| replace_unsynced(path, &bytes)).at(path.display())?;
    Ok(crc32fast::hash(&bytes))
}

/// Whether a row of these is one that no action follows.
pub(super) fn has_no_action(row: &Batch) -> bool {
    let Some(column) = row.schema().index(ACTION) else { return false };
    match row.column(column) {
        Slice::F32(values) => values.iter().all(|value| value.is_nan()),
        Slice::F64(values) => values.iter().all(|value| value.is_nan()),
        Slice::I32(values) => values.iter().all(|&value| value == -1),
        Slice::I64(values) => values.iter().all(|&value| value == -1),
        _ => false,
    }
}

/// Some rows of a table.
pub(super) fn part(batch: &Batch, first: usize, count: usize) -> Result<Batch> {
    let mut part = Batch::new(batch.schema().clone(), count);
    for (column, field) in batch.schema().fields().iter().enumerate() {
        let width = field.dim();
        if !part.column_mut(column).copy_from(batch.column(column).range(first * width, count * width)) {
            return Err(wrong_type(format!("column `{}` has another type", field.name)));
        }
    }
    Ok(part)
}
