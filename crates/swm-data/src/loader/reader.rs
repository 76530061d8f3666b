//! Reading clips: one thread's handle on the dataset and its working memory.

use swm_core::{RowsMut, SliceMut};

use super::images::Darkroom;
use super::plan::{Plan, Rows};
use super::wrong;
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

/// A handle on the dataset, and memory for the images of one clip.
pub(super) struct Reader {
    dataset: Box<dyn Dataset>,
    /// By window.
    darkrooms: Vec<Darkroom>,
}

impl Reader {
    pub(super) fn new(dataset: Box<dyn Dataset>) -> Self {
        Self { dataset, darkrooms: Vec::new() }
    }

    /// Reads clips into `rows`, one row per clip.
    pub(super) fn read(
        &mut self,
        plan: &Plan,
        epoch: u64,
        clips: &[usize],
        mut rows: RowsMut<'_>,
    ) -> Result<(), DataError> {
        self.darkrooms.resize_with(plan.windows.len(), Darkroom::default);
        for (row, &index) in clips.iter().enumerate() {
            let Some(clip) = plan.index.get(index) else {
                return wrong(
                    "clips",
                    format!("clip {index} does not exist, there are {}", plan.index.len()),
                );
            };
            let goal = plan.goals.as_ref().map_or((0, 0), |goals| goals.draw(epoch, index, clip));
            let row = rows.select(row);
            for (target, (window, darkroom)) in plan.windows.iter().zip(&mut self.darkrooms).enumerate() {
                let (episode, steps) = match window.rows {
                    Rows::Clip { count, stride } => {
                        (clip.episode, Steps { first: clip.start, count, stride })
                    }
                    Rows::Goal => (goal.0, Steps { first: goal.1, count: 1, stride: 1 }),
                };
                let (dataset, column) = (&mut self.dataset, window.column);
                match (&window.convert, row.slice_mut(target)) {
                    (Some(convert), SliceMut::U8(out)) => convert.run(darkroom, out, |stored| {
                        dataset.read_column(column, episode, steps, SliceMut::U8(stored))
                    })?,
                    (_, out) => dataset.read_column(column, episode, steps, out)?,
                }
            }
        }
        Ok(())
    }
}
