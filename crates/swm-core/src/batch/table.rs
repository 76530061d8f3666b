//! A table of typed columns: `World`'s infos (row = environment) and a recorded episode (row = step) alike.

use std::sync::Arc;

use super::rows::{Row, RowsMut};
use super::{Column, Element, Schema, Slice, SliceMut};
use crate::error::BatchError;

/// A schema and its columns. Allocated once; rows are then written in place.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    schema: Arc<Schema>,
    rows: usize,
    columns: Vec<Column>,
}

impl Batch {
    /// `rows` rows of zeros.
    pub fn new(schema: Arc<Schema>, rows: usize) -> Self {
        let columns =
            schema.fields().iter().map(|field| Column::zeros(field.dtype, rows * field.dim())).collect();
        Self { schema, rows, columns }
    }

    /// The fields.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Column `index`, all rows: `[rows, …shape]` values, row-major.
    pub fn column(&self, index: usize) -> Slice<'_> {
        self.columns[index].as_slice()
    }

    /// Column `index`, mutably.
    pub fn column_mut(&mut self, index: usize) -> SliceMut<'_> {
        self.columns[index].as_slice_mut()
    }

    /// The column `name` as `[rows, …shape]` values of type `T`.
    ///
    /// # Errors
    ///
    /// There is no such column, or its values are of another type; the error says which.
    pub fn get<T: Element>(&self, name: &str) -> Result<&[T], BatchError> {
        let index = self.schema.require(name)?;
        self.column(index).get().ok_or_else(|| self.wrong_type(index, T::DTYPE))
    }

    /// The column `name`, mutably; see [`Batch::get`].
    ///
    /// ```
    /// use swm_core::{Batch, Dtype, Field, Schema};
    ///
    /// let mut rows = Batch::new(Schema::new(vec![Field::step("force", Dtype::F32, &[3])])?, 2);
    /// rows.get_mut::<f32>("force")?.fill(0.5);
    /// assert_eq!(rows.get::<f32>("force")?, [0.5; 6]);
    /// assert!(rows.get_mut::<f64>("force").is_err());
    /// # Ok::<(), swm_core::BatchError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// There is no such column, or its values are of another type; the error says which.
    pub fn get_mut<T: Element>(&mut self, name: &str) -> Result<&mut [T], BatchError> {
        let index = self.schema.require(name)?;
        if self.column(index).get::<T>().is_none() {
            return Err(self.wrong_type(index, T::DTYPE));
        }
        Ok(T::of_mut(self.column_mut(index)).unwrap_or_default())
    }

    /// One row.
    pub fn row(&self, row: usize) -> Row<'_> {
        assert!(row < self.rows, "row {row} of a table with {} rows", self.rows);
        Row { table: self, row }
    }

    /// All rows, to be split into disjoint parts and written.
    pub fn rows_mut(&mut self) -> RowsMut<'_> {
        RowsMut {
            schema: &self.schema,
            rows: self.rows,
            selected: 0,
            columns: self.columns.iter_mut().map(Column::as_slice_mut).collect(),
        }
    }

    /// Appends the fields of this table from `row`, taken from the columns `from` of the row's table (one per
    /// field, in order).
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: a column of the row has another type or dimension than the field. The table is then
    /// unusable.
    pub fn push_row(
        &mut self,
        row: Row<'_>,
        from: impl IntoIterator<Item = usize>,
    ) -> Result<(), BatchError> {
        for (target, source) in from.into_iter().enumerate() {
            let values = row.at(source);
            let field = &self.schema.fields()[target];
            if values.len() != field.dim() || !self.columns[target].extend(values) {
                return Err(BatchError::WrongValue {
                    name: field.name.clone(),
                    expected: format!("{} {:?}", field.dtype, field.shape),
                    found: format!("{} values of {}", values.len(), values.dtype()),
                });
            }
        }
        self.rows += 1;
        Ok(())
    }

    /// Changes the number of rows; new ones are zero. Keeps the memory.
    pub fn resize(&mut self, rows: usize) {
        for (field, column) in self.schema.fields().iter().zip(&mut self.columns) {
            column.resize(rows * field.dim());
        }
        self.rows = rows;
    }

    /// Forgets all rows and keeps the memory.
    pub fn clear(&mut self) {
        self.columns.iter_mut().for_each(Column::clear);
        self.rows = 0;
    }

    /// The columns, one per field, `[rows, …shape]` values each.
    pub fn into_columns(self) -> Vec<Column> {
        self.columns
    }

    fn wrong_type(&self, index: usize, wanted: super::Dtype) -> BatchError {
        let field = &self.schema.fields()[index];
        BatchError::WrongValue {
            name: field.name.clone(),
            expected: field.dtype.to_string(),
            found: format!("a request for {wanted}"),
        }
    }
}
