//! One pass over all clips, in batches, in order or shuffled.

use swm_core::Batch;
use swm_core::seed::keyed;

use super::Loader;
use crate::error::DataError;

use rand::seq::SliceRandom;

/// The order of one pass, and how far it is.
pub struct Epoch<'a> {
    loader: &'a mut Loader,
    order: Vec<usize>,
    batch: usize,
    next: usize,
}

impl<'a> Epoch<'a> {
    pub(super) fn new(loader: &'a mut Loader, batch: usize, shuffle: Option<(u64, u64)>) -> Self {
        let mut order: Vec<usize> = (0..loader.len()).collect();
        if let Some((seed, epoch)) = shuffle {
            order.shuffle(&mut keyed(seed, "loader", [epoch, 0]));
        }
        Self { loader, order, batch: batch.max(1), next: 0 }
    }

    /// The clips in the order in which they come.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// Fills `batch` with the next clips, `false` if there are no more. The last batch may be smaller.
    pub fn next_into(&mut self, batch: &mut Batch) -> Result<bool, DataError> {
        let end = (self.next + self.batch).min(self.order.len());
        let clips = &self.order[self.next..end];
        if clips.is_empty() {
            return Ok(false);
        }
        self.loader.read(clips, batch)?;
        self.next = end;
        Ok(true)
    }
}
