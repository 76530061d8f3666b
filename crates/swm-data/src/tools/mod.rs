//! What one does to whole datasets: copy them, prove them sound, compare them. All stream: an episode or a block of rows
//! is in memory, never a dataset.

pub mod compare;
pub mod compatibility;
pub mod copy;
pub mod part_folder;
pub mod parts;
mod resume_check;
mod sample;
pub mod verify;

pub use sample::sample_digest;
use swm_core::{Column, Field};

use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

/// Bytes of a column that are in memory at once.
const BLOCK_BYTES: usize = 8 << 20;

/// Hands the rows of a column to `take`, block by block, with the number of the first row.
fn blocks(
    dataset: &mut dyn Dataset,
    column: usize,
    episode: usize,
    mut take: impl FnMut(usize, &Column) -> Result<(), DataError>,
) -> Result<(), DataError> {
    let (rows, field) = (dataset.episode_len(episode), dataset.schema().fields()[column].clone());
    let per_block = rows_per_block(&field);
    let mut values = Column::zeros(field.dtype, 0);
    for first in (0..rows).step_by(per_block) {
        let count = per_block.min(rows - first);
        values.resize(count * field.dim());
        let steps = Steps { first, count, stride: 1 };
        dataset.read_column(column, episode, steps, values.as_slice_mut())?;
        take(first, &values)?;
    }
    Ok(())
}

fn rows_per_block(field: &Field) -> usize {
    (BLOCK_BYTES / (8 * field.dim()).max(1)).max(1)
}
