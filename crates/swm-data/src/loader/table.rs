//! What a loader fills: a [`Batch`], or a table over memory of another owner.

use swm_core::{Batch, RowsMut, Schema};

/// A table that a loader fills. [`Batch`] is one; another may lie over foreign memory, such as pinned tensors.
pub trait Table: Send + 'static {
    /// Its columns.
    fn schema(&self) -> &Schema;

    /// Sets the number of rows. A loader asks for no more than a batch holds, and overwrites all values.
    fn resize(&mut self, rows: usize);

    /// All rows, for writing.
    fn rows_mut(&mut self) -> RowsMut<'_>;
}

impl Table for Batch {
    fn schema(&self) -> &Schema {
        self.schema()
    }

    fn resize(&mut self, rows: usize) {
        self.resize(rows);
    }

    fn rows_mut(&mut self) -> RowsMut<'_> {
        self.rows_mut()
    }
}
