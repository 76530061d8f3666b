//! An open dataset of another program: every row of an episode is a row of some array, or missing.

use std::sync::Arc;

use swm_core::{Column as Values, SliceMut};
use swm_data::dataset::{Dataset, DatasetInfo, Origin, Steps};
use swm_data::element::first_failing;
use swm_data::error::{DataError, Result, invalid};

use super::array::{Scratch, Shared, of_other_program};

/// Where the rows of an episode are: the first of them end to end in an array, then perhaps one in another; the rest is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Span {
    /// Position of the array among those of the column.
    pub(super) array: usize,
    /// Its row that is the first of the episode.
    pub(super) first: usize,
    /// How many rows of the episode are there.
    pub(super) count: usize,
    /// The array, and the row of it, that has the row behind those.
    pub(super) tail: Option<(usize, usize)>,
}

impl Span {
    /// No row of the episode is there.
    pub(super) const NONE: Self = Self { array: 0, first: 0, count: 0, tail: None };
}

/// The arrays of a column, and where the rows of each episode are in them.
#[derive(Debug)]
pub(super) struct Column {
    pub(super) arrays: Vec<Shared>,
    pub(super) spans: Vec<Span>,
}

impl Column {
    fn read(
        &self,
        episode: usize,
        steps: Steps,
        dim: usize,
        out: SliceMut<'_>,
        scratch: &mut Scratch,
    ) -> Result<()> {
        let span = self.spans.get(episode).ok_or_else(|| invalid("it has no such episode"))?;
        let stored = span.count.saturating_sub(steps.first).div_ceil(steps.stride.max(1)).min(steps.count);
        let (head, mut rest) = out.split_at(stored * dim);
        if stored > 0 {
            self.rows(
                span.array,
                Steps { first: span.first + steps.first, count: stored, ..steps },
                head,
                scratch,
            )?;
        }
        for index in stored..steps.count {
            let (mut row, behind) = rest.split_at(dim);
            rest = behind;
            match span.tail {
                Some((array, at)) if steps.first + index * steps.stride == span.count => {
                    self.rows(array, Steps { first: at, count: 1, stride: 1 }, row, scratch)?;
                }
                _ => row.fill_missing(),
            }
        }
        Ok(())
    }

    fn rows(&self, array: usize, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let array = self.arrays.get(array).ok_or_else(|| invalid("it has no such array"))?;
        if rows.end().is_none_or(|end| end > array.rows()) {
            return Err(invalid(format!("it has {} rows, too few for row {}", array.rows(), rows.first)));
        }
        if out.dtype() != array.dtype() || out.len() != rows.count * array.dim() {
            return Err(invalid(format!(
                "its rows are {} {:?} here, unlike in the first episode",
                array.dtype(),
                array.shape()
            )));
        }
        array.read(rows, out, scratch).map_err(of_other_program)
    }
}

/// An open dataset.
pub(super) struct ForeignDataset {
    info: DatasetInfo,
    columns: Arc<[Column]>,
    scratch: Scratch,
}

impl ForeignDataset {
    pub(super) fn new(info: DatasetInfo, columns: Vec<Column>) -> Self {
        Self { info, columns: columns.into(), scratch: Scratch::default() }
    }
}

impl Dataset for ForeignDataset {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn origin(&self) -> Option<Origin> {
        Some(Origin::of(&self.info))
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let dim = self.info.field(column).dim();
        let (columns, scratch) = (&self.columns[column], &mut self.scratch);
        let dtype = out.dtype();
        let mut read = |steps, out: SliceMut<'_>| columns.read(episode, steps, dim, out, scratch);
        read(steps, out).map_err(|error| {
            let read = |steps: Steps| read(steps, Values::zeros(dtype, steps.count * dim).as_slice_mut());
            let (row, error) = first_failing(steps, error, read);
            self.info.damaged(column, episode, error.at(format_args!("row {row}")))
        })
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { info: self.info.clone(), columns: self.columns.clone(), scratch: Scratch::default() })
    }
}
