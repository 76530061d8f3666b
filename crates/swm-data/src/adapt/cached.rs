//! Whole columns in memory, read once and shared by all handles; for small columns that every clip needs.

use std::sync::Arc;

use swm_core::{Column, SliceMut};

use super::inner::of_inner;
use crate::dataset::{Dataset, Steps, copy_rows};
use crate::error::DataError;

/// A dataset some of whose columns are held in memory.
pub struct Cached {
    inner: Box<dyn Dataset>,
    held: Arc<Held>,
}

struct Held {
    /// By column of the dataset, the values of all episodes end to end.
    columns: Vec<Option<Column>>,
    /// By episode, its first row.
    first: Vec<usize>,
}

impl Cached {
    /// Reads the columns `keys` into memory.
    ///
    /// # Errors
    ///
    /// No such column, or reading fails.
    pub fn new(mut inner: Box<dyn Dataset>, keys: &[&str]) -> Result<Self, DataError> {
        let lengths = inner.info().lengths.clone();
        let first: Vec<usize> = lengths
            .iter()
            .scan(0, |end, len| {
                let first = *end;
                *end += len;
                Some(first)
            })
            .collect();
        let rows: usize = lengths.iter().sum();
        let fields = inner.schema().fields().to_vec();
        let mut columns: Vec<Option<Column>> = vec![None; fields.len()];
        for key in keys {
            let column = inner.schema().require(key);
            let column = column.map_err(|error| DataError::request(inner.path(), error.to_string()))?;
            let width = fields[column].dim();
            let mut values = Column::zeros(fields[column].dtype, rows * width);
            let mut rest = values.as_slice_mut();
            for (episode, &len) in lengths.iter().enumerate() {
                let (here, after) = rest.split_at(len * width);
                rest = after;
                inner.read_column(column, episode, Steps { first: 0, count: len, stride: 1 }, here)?;
            }
            columns[column] = Some(values);
        }
        Ok(Self { inner, held: Arc::new(Held { columns, first }) })
    }
}

impl Dataset for Cached {
    of_inner!(info, looks, origin, checks);

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let Some(Some(values)) = self.held.columns.get(column) else {
            return self.inner.rows(column, episode, steps, out);
        };
        let steps = Steps { first: self.held.first[episode] + steps.first, ..steps };
        copy_rows(values.as_slice(), self.info().field(column).dim(), steps, out);
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { inner: self.inner.share(), held: self.held.clone() })
    }
}
