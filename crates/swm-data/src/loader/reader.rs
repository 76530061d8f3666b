//! Reading clips: one thread's handle on the dataset and its working memory.

use swm_core::{RowsMut, SliceMut};

use super::floats::{Scratch, add_up, narrow};
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
    scratch: Scratch,
}

impl Reader {
    pub(super) fn new(dataset: Box<dyn Dataset>) -> Self {
        Self { dataset, darkrooms: Vec::new(), scratch: Scratch::default() }
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
            self.dataset.dress(Some([epoch, index as u64]))?;
            let row = rows.select(row);
            for (target, (window, darkroom)) in plan.windows.iter().zip(&mut self.darkrooms).enumerate() {
                let (episode, steps) = match window.rows {
                    Rows::Clip { count, stride } => {
                        (clip.episode, Steps { first: clip.start, count, stride })
                    }
                    Rows::Goal => (goal.0, Steps { first: goal.1, count: 1, stride: 1 }),
                    Rows::Rewards { steps, skip, after } => {
                        let first = clip.start + after;
                        // The last action of a clip may be the episode's, after which nothing is recorded.
                        let left = self.dataset.episode_len(clip.episode) - first;
                        (clip.episode, Steps { first, count: left.min(steps * skip), stride: 1 })
                    }
                };
                let (dataset, column) = (&mut self.dataset, window.column);
                let mut read = |out: SliceMut<'_>| dataset.read_column(column, episode, steps, out);
                match (&window.convert, window.rows, row.slice_mut(target)) {
                    (Some(convert), _, SliceMut::U8(out)) => {
                        convert.run(darkroom, out, |stored| read(SliceMut::U8(stored)))?;
                    }
                    (_, Rows::Rewards { skip, .. }, out) => {
                        add_up(&mut self.scratch, window, steps.count, skip, out, read)?;
                    }
                    (_, _, SliceMut::F32(out)) if window.narrows => narrow(&mut self.scratch, out, read)?,
                    (_, _, out) => read(out)?,
                }
            }
        }
        Ok(())
    }
}
