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
        let width = self.schema().fields()[index].width();
        self.table.column(index).range(self.row * width, width)
    }

    /// The values of the field `name` as `T`.
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

/// How many columns fit without an allocation; the widest environment so far has 40.
const INLINE_COLUMNS: usize = 48;

/// A range of rows of a [`Batch`], open for writing.
#[derive(Debug)]
pub struct RowsMut<'a> {
    pub(super) schema: &'a Schema,
    pub(super) rows: usize,
    pub(super) columns: SmallVec<[SliceMut<'a>; INLINE_COLUMNS]>,
}

impl<'a> RowsMut<'a> {
    /// The fields.
    pub fn schema(&self) -> &'a Schema {
        self.schema
    }

    /// The number of rows in the range.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Two disjoint ranges: the first `at` rows and the rest.
    pub fn split_at(self, at: usize) -> (RowsMut<'a>, RowsMut<'a>) {
        let (mut left, mut right) = (SmallVec::new(), SmallVec::new());
        for (field, column) in self.schema.fields().iter().zip(self.columns) {
            let (head, tail) = column.split_at(at * field.width());
            left.push(head);
            right.push(tail);
        }
        (
            RowsMut { schema: self.schema, rows: at, columns: left },
            RowsMut { schema: self.schema, rows: self.rows - at, columns: right },
        )
    }

    /// The values of field `index` in this range: `[rows, …shape]`.
    ///
    /// # Panics
    /// If the field has another type: environments name their own fields by constants, so this is a programming
    /// error (which the conformance suite finds).
    pub fn at<T: Element>(&mut self, index: usize) -> &mut [T] {
        let field = &self.schema.fields()[index];
        let values = T::of_mut(self.columns[index].reborrow());
        values.unwrap_or_else(|| panic!("field `{}` holds {}, not {}", field.name, field.dtype, T::DTYPE))
    }

    /// Copies `values` into field `index`; their number must be `rows × width`.
    ///
    /// # Panics
    /// If type or number differ, as [`RowsMut::at`].
    pub fn write<T: Element>(&mut self, index: usize, values: &[T]) {
        self.at(index).clone_from_slice(values);
    }

    /// The untyped values of field `index`.
    pub fn slice_mut(&mut self, index: usize) -> SliceMut<'_> {
        self.columns[index].reborrow()
    }
}
