//! Rows of a table: one to read, or a contiguous range to write, which splits into disjoint parts so that
//! environments write in parallel without locks.

use smallvec::SmallVec;

use super::{Batch, Element, Schema, Slice, SliceMut};
use crate::error::BatchError;

/// One row of a [`Batch`].
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    pub(super) table: &'a Batch,
    pub(super) row: usize,
}

impl<'a> Row<'a> {
    /// The fields.
    pub fn schema(&self) -> &'a Schema {
        self.table.schema()
    }

    /// The values of field `index`.
    pub fn at(&self, index: usize) -> Slice<'a> {
        let dim = self.schema().dim(index);
        self.table.column(index).range(self.row * dim, dim)
    }

    /// The values of the field `name` as `T`, row-major.
    ///
    /// # Errors
    ///
    /// There is no such field, or its values are of another type; the error says which.
    pub fn get<T: Element>(&self, name: &str) -> Result<&'a [T], BatchError> {
        let index = self.schema().require(name)?;
        let field = &self.schema().fields()[index];
        self.at(index).get().ok_or_else(|| BatchError::WrongValue {
            name: name.to_owned(),
            expected: field.dtype.to_string(),
            found: format!("a request for {}", T::DTYPE),
        })
    }
}

/// How many columns fit without an allocation; the widest environment so far has 73.
const INLINE_COLUMNS: usize = 96;

/// A range of rows of a [`Batch`], open for writing, of which one is selected (the first, to begin with).
#[derive(Debug)]
pub struct RowsMut<'a> {
    pub(super) schema: &'a Schema,
    pub(super) rows: usize,
    pub(super) selected: usize,
    pub(super) columns: SmallVec<[SliceMut<'a>; INLINE_COLUMNS]>,
}

impl<'a> RowsMut<'a> {
    /// `rows` rows over memory of any owner: for every field of `schema`, its `[rows, …shape]` values.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: a slice is missing, left over, or of another type or length than its field.
    pub fn over(
        schema: &'a Schema,
        rows: usize,
        slices: impl IntoIterator<Item = SliceMut<'a>>,
    ) -> Result<Self, BatchError> {
        let columns: SmallVec<_> = slices.into_iter().collect();
        let wrong = |name: &str, expected: String, found: String| {
            Err(BatchError::WrongValue { name: name.to_owned(), expected, found })
        };
        if columns.len() != schema.fields().len() {
            let (expected, found) = (schema.fields().len(), columns.len());
            return wrong("slices", format!("{expected}, one per field"), found.to_string());
        }
        for (index, field) in schema.fields().iter().enumerate() {
            let (column, len): (&SliceMut<'_>, _) = (&columns[index], rows * schema.dim(index));
            if column.dtype() != field.dtype || column.len() != len {
                let found = format!("{} values of {}", column.len(), column.dtype());
                return wrong(&field.name, format!("{len} values of {}", field.dtype), found);
            }
        }
        Ok(Self { schema, rows, selected: 0, columns })
    }

    /// The fields.
    pub fn schema(&self) -> &'a Schema {
        self.schema
    }

    /// The number of rows in the range.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Selects the row that the other methods write, counted from the start of the range.
    pub fn select(&mut self, row: usize) -> &mut Self {
        assert!(row < self.rows, "row {row} of a range of {} rows", self.rows);
        self.selected = row;
        self
    }

    /// The same range, for a shorter time.
    pub fn reborrow(&mut self) -> RowsMut<'_> {
        let columns = self.columns.iter_mut().map(SliceMut::reborrow).collect();
        RowsMut { schema: self.schema, rows: self.rows, selected: self.selected, columns }
    }

    /// Two disjoint ranges: the first `at` rows and the rest.
    pub fn split_at(self, at: usize) -> (RowsMut<'a>, RowsMut<'a>) {
        let (mut left, mut right) = (SmallVec::new(), SmallVec::new());
        for (index, column) in self.columns.into_iter().enumerate() {
            let (head, tail) = column.split_at(at * self.schema.dim(index));
            left.push(head);
            right.push(tail);
        }
        (
            RowsMut { schema: self.schema, rows: at, selected: 0, columns: left },
            RowsMut { schema: self.schema, rows: self.rows - at, selected: 0, columns: right },
        )
    }

    /// The values of field `index` in the selected row: `[…shape]`.
    ///
    /// # Panics
    /// If the field has another type: environments name their own fields by constants, so this is a programming
    /// error (which the conformance suite finds).
    pub fn at<T: Element>(&mut self, index: usize) -> &mut [T] {
        let (dim, row) = (self.schema.dim(index), self.selected);
        match T::of_mut(self.columns[index].reborrow()) {
            Some(values) => &mut values[row * dim..(row + 1) * dim],
            None => {
                let field = &self.schema.fields()[index];
                panic!("field `{}` holds {}, not {}", field.name, field.dtype, T::DTYPE)
            }
        }
    }

    /// Copies `values` into field `index` of the selected row.
    ///
    /// # Panics
    /// If type or number differ, as [`RowsMut::at`].
    pub fn write<T: Element>(&mut self, index: usize, values: &[T]) {
        let out = self.at(index);
        if out.len() == values.len() {
            return out.clone_from_slice(values);
        }
        let field = &self.schema.fields()[index];
        let (name, shape, takes) = (&field.name, &field.shape, field.dim());
        panic!(
            "field `{name}` has the shape {shape:?} and takes {takes} values, found {}; write as many, or declare the field with \
             another shape",
            values.len()
        )
    }

    /// Copies a row of a table with the same schema into the selected row.
    pub(crate) fn copy_row(&mut self, row: Row<'_>) {
        for index in 0..self.columns.len() {
            assert!(self.slice_mut(index).copy_from(row.at(index)), "one schema made both");
        }
    }

    /// The untyped values of field `index` in the selected row.
    pub fn slice_mut(&mut self, index: usize) -> SliceMut<'_> {
        let dim = self.schema.dim(index);
        let (_, rest) = self.columns[index].reborrow().split_at(self.selected * dim);
        rest.split_at(dim).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Dtype, Field};

    fn write(values: &[f64]) {
        let fields = vec![Field::step("reward", Dtype::F64, &[]), Field::step("pose", Dtype::F64, &[2, 3])];
        let mut rows = Batch::new(Schema::new(fields).unwrap(), 1);
        rows.rows_mut().write(1, values);
    }

    #[test]
    #[should_panic(expected = "field `pose` has the shape [2, 3] and takes 6 values, found 4; write as many")]
    fn values_of_another_length_are_refused_by_the_fields_name() {
        write(&[0.0; 6]);
        write(&[0.0; 4]);
    }
}
