//! What the rows of a dataset state of themselves, in columns that number episodes and steps, compared with where the index of episodes
//! places them. An index that another program left as it was when it moved rows would give an episode the rows of another.

use std::sync::atomic::{AtomicBool, Ordering};

use swm_core::{Dtype, Schema};

use crate::error::{Result, invalid};
use crate::recording::EP_IDX;

/// Columns that number episodes.
const EPISODES: [&str; 3] = [EP_IDX, "episode_idx", "episode_index"];
/// Columns that number the steps of an episode.
const STEPS: [&str; 2] = ["step_idx", "frame_index"];

/// The columns that number rows, and which episodes have been compared.
#[derive(Debug)]
pub(super) struct Labels {
    episodes: Option<usize>,
    steps: Option<usize>,
    /// Whether episodes are numbered from 0 on: other programs take some out, and leave their numbers.
    is_ours: bool,
    compared: Box<[AtomicBool]>,
}

impl Labels {
    pub(super) fn of(schema: &Schema, episodes: usize, is_ours: bool) -> Self {
        let column = |names: &[&str]| {
            let known = names.iter().find_map(|name| schema.index(name))?;
            let field = &schema.fields()[known];
            (matches!(field.dtype, Dtype::I32 | Dtype::I64) && field.dim() == 1).then_some(known)
        };
        let compared = (0..episodes).map(|_| AtomicBool::new(false)).collect();
        // In ours, other names are those of columns with a meaning of their own.
        let episodes = column(if is_ours { &EPISODES[..1] } else { &EPISODES });
        // Steps may be counted in many ways, so that they count only where nothing else does.
        Self { episodes, steps: if episodes.is_none() { column(&STEPS) } else { None }, is_ours, compared }
    }

    /// Compares the first and the last row of an episode of so many rows, once. `read` gives the number in a column and a row of it.
    ///
    /// # Errors
    ///
    /// They are of another episode, or of two; or reading fails.
    pub(super) fn check(
        &self,
        episode: usize,
        rows: usize,
        mut read: impl FnMut(usize, usize) -> Result<i64>,
    ) -> Result<()> {
        let Some(last) = rows.checked_sub(1) else { return Ok(()) };
        if self.compared[episode].load(Ordering::Relaxed) {
            return Ok(());
        }
        let fix = "the index of episodes does not fit the rows: get the dataset again, or index it anew";
        if let Some(column) = self.episodes {
            let numbers = [read(column, 0)?, read(column, last)?];
            if numbers[0] != numbers[1] {
                return Err(invalid(format!(
                    "its first row is of episode {} and its last of episode {}; {fix}",
                    numbers[0], numbers[1]
                )));
            }
            if self.is_ours && numbers[0] != episode as i64 {
                return Err(invalid(format!("its rows are of episode {}; {fix}", numbers[0])));
            }
        }
        if let Some(column) = self.steps {
            let numbers = [read(column, 0)?, read(column, last)?];
            if numbers[1].saturating_sub(numbers[0]) < last as i64 {
                return Err(invalid(format!(
                    "its {rows} rows begin at step {} and end at step {}; {fix}",
                    numbers[0], numbers[1]
                )));
            }
        }
        self.compared[episode].store(true, Ordering::Relaxed);
        Ok(())
    }
}

/// A single number that `read` fills in, of a column of this type.
pub(super) fn number(dtype: Dtype, read: impl FnOnce(swm_core::SliceMut<'_>) -> Result<()>) -> Result<i64> {
    let mut column = swm_core::Column::zeros(dtype, 1);
    read(column.as_slice_mut())?;
    match column {
        swm_core::Column::I32(values) => Ok(i64::from(values[0])),
        swm_core::Column::I64(values) => Ok(values[0]),
        _ => Err(invalid("it holds no whole numbers")),
    }
}
