//! Rows of a column as a format stores them: compressed, each on its own.

use crate::batch::{Batch, Row, Schema};
use crate::error::BatchError;

/// Brings rows of one column into the form in which a format stores them, on whichever thread they are made.
pub trait RowEncoder: Send {
    /// Appends the stored form of a row to `out`. `row` has the values of one row, of a column of bytes.
    fn encode(&mut self, row: &[u8], out: &mut EncodedRows);
}

/// Stored rows of one column, end to end. A copy between two datasets that store them alike passes them on without decoding.
#[derive(Clone, Debug, Default)]
pub struct EncodedRows {
    bytes: Vec<u8>,
    /// For every row, where it ends and whether it is compressed.
    ends: Vec<(usize, bool)>,
}

/// A row as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodedRow<'a> {
    /// The stored bytes.
    pub bytes: &'a [u8],
    /// Whether its values are compressed in them; they are not where that would make them no smaller.
    pub is_compressed: bool,
}

impl EncodedRows {
    /// Removes all rows, and keeps the memory.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
    }

    /// Appends a row.
    pub fn push(&mut self, row: EncodedRow<'_>) {
        self.bytes.extend_from_slice(row.bytes);
        self.ends.push((self.bytes.len(), row.is_compressed));
    }

    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The rows in order.
    pub fn iter(&self) -> impl Iterator<Item = EncodedRow<'_>> {
        let starts = std::iter::once(0).chain(self.ends.iter().map(|&(end, _)| end));
        let row = |(start, &(end, is_compressed)): (usize, &(usize, bool))| EncodedRow {
            bytes: &self.bytes[start..end],
            is_compressed,
        };
        starts.zip(&self.ends).map(row)
    }
}

/// Rows of which some columns are as a format stores them, and the others are values.
#[derive(Clone, Debug)]
pub struct EncodedBatch {
    /// The columns of which there are values.
    pub plain: Batch,
    /// The others, by their positions in the schema of the whole, with as many rows.
    pub encoded: Vec<(usize, EncodedRows)>,
    /// For every column of `plain`, its position in the schema of the whole.
    positions: Vec<usize>,
}

impl EncodedBatch {
    /// No rows of the columns of `schema`.
    pub fn new(schema: &Schema, is_encoded: impl Fn(usize) -> bool) -> Self {
        let (encoded, positions): (Vec<_>, Vec<_>) =
            (0..schema.fields().len()).partition(|&at| is_encoded(at));
        let plain = positions.iter().map(|&column| schema.fields()[column].clone()).collect();
        let plain = Schema::new(plain).expect("a part of a schema is one");
        let encoded = encoded.into_iter().map(|column| (column, EncodedRows::default())).collect();
        Self { plain: Batch::new(plain, 0), encoded, positions }
    }

    /// How many rows there are.
    pub fn rows(&self) -> usize {
        self.plain.rows()
    }

    /// The bytes of memory that the rows take; text counts without its letters.
    pub fn bytes(&self) -> usize {
        let encoded: usize = self.encoded.iter().map(|(_, rows)| rows.bytes.len()).sum();
        encoded + self.rows() * self.plain.schema().row_bytes()
    }

    /// Removes all rows, and keeps the memory.
    pub fn clear(&mut self) {
        self.plain.clear();
        self.encoded.iter_mut().for_each(|(_, rows)| rows.clear());
    }

    /// Appends a row: for every column of the whole, `from` has its position in `row`. `encoders` has one for each encoded
    /// column, in their order.
    pub(super) fn push_row(
        &mut self,
        row: Row<'_>,
        from: &[usize],
        encoders: &mut [Box<dyn RowEncoder>],
    ) -> Result<(), BatchError> {
        for ((column, out), encoder) in self.encoded.iter_mut().zip(encoders) {
            let source = from[*column];
            let values = row.at(source);
            let values = values.get().ok_or_else(|| BatchError::WrongValue {
                name: row.schema().fields()[source].name.clone(),
                expected: "uint8, of which alone rows are encoded".to_owned(),
                found: values.dtype().to_string(),
            })?;
            encoder.encode(values, out);
        }
        self.plain.push_row(row, self.positions.iter().map(|&column| from[column]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_in_order_and_memory_is_used_again() {
        let row = |bytes, is_compressed| EncodedRow { bytes, is_compressed };
        let stored = [row(&b"one"[..], true), row(b"", false), row(b"three", true)];
        let mut rows = EncodedRows::default();
        for _ in 0..2 {
            rows.clear();
            stored.iter().for_each(|&row| rows.push(row));
            assert_eq!(rows.iter().collect::<Vec<_>>(), stored);
            assert_eq!((rows.len(), rows.is_empty()), (3, false));
        }
    }
}
