//! A dataset whose reading can be ended from another thread.

use std::ops::Range;

use swm_core::{Cancel, SliceMut};

use super::inner::of_inner;
use crate::dataset::{Dataset, EncodedRows, Steps};
use crate::error::DataError;

/// A dataset that is read until a flag is set; from then on, reading is an error.
pub struct Watched {
    inner: Box<dyn Dataset>,
    cancel: Cancel,
}

impl Watched {
    /// The dataset, until `cancel` is set.
    pub fn new(inner: Box<dyn Dataset>, cancel: Cancel) -> Self {
        Self { inner, cancel }
    }

    fn check(&self) -> Result<(), DataError> {
        match self.cancel.is_cancelled() {
            true => Err(DataError::request(self.path(), "reading was interrupted")),
            false => Ok(()),
        }
    }
}

impl Dataset for Watched {
    of_inner!(info, origin);

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        self.check()?;
        self.inner.dress(key)
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        self.check()?;
        self.inner.rows(column, episode, steps, out)
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { inner: self.inner.share(), cancel: self.cancel.clone() })
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        self.check()?;
        self.inner.check_whole()
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        self.check()?;
        self.inner.check_episode(episode)
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        self.inner.encoding(column)
    }

    fn encoded_rows(
        &mut self,
        column: usize,
        episode: usize,
        rows: Range<usize>,
        out: &mut EncodedRows,
    ) -> Result<(), DataError> {
        self.check()?;
        self.inner.encoded_rows(column, episode, rows, out)
    }
}
