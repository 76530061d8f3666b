//! Rows as they are stored: which columns have them, and writing them so that the file is the one that the library would
//! write from their values.

use std::mem;

use hdf5_metno::Dataset;
use hdf5_metno::filters::{Blosc, BloscShuffle, Filter};
use swm_core::{Dtype, Field, FieldKind, Slice};

use super::handles::library_error;
use super::{blosc, checksum, ffi, library};
use crate::dataset::{EncodedRow, EncodedRows, RowEncoder};
use crate::error::{Result, invalid};

/// How a column is stored of which every row is a chunk of its own.
#[derive(Clone, Debug)]
pub(super) struct StoredForm {
    /// What the rows of two columns must agree in to be copied as they are stored.
    pub(super) name: String,
    level: u8,
    shuffle: BloscShuffle,
    /// Whether a row may well be equal to the one before, such as the image of a goal.
    repeats: bool,
}

impl StoredForm {
    /// Of a column of bytes whose rows are compressed each on its own, with a checksum, as ours are.
    pub(super) fn of(dataset: &Dataset, field: &Field) -> hdf5_metno::Result<Option<Self>> {
        let is_by_row = dataset.chunk().is_some_and(|chunk| chunk[0] == 1 && chunk[1..] == field.shape);
        if !is_by_row || field.dtype != Dtype::U8 {
            return Ok(None);
        }
        let filters = dataset.dcpl()?.get_filters()?;
        let [Filter::Blosc(Blosc::LZ4, level, shuffle), Filter::Fletcher32] = filters[..] else {
            return Ok(None);
        };
        let (name, repeats) = (format!("hdf5 {filters:?}"), field.kind == FieldKind::Episode);
        Ok(Some(Self { name, level, shuffle, repeats }))
    }
}

/// Encodes rows as the library would, without its copies of each, and a row that is equal to the one before once.
#[derive(Debug)]
pub(super) struct Encoder {
    pub(super) form: StoredForm,
    /// The values of the last row, if they may come again.
    values: Vec<u8>,
    /// As it is stored, in its first `size` bytes: the rest is room.
    stored: Vec<u8>,
    size: usize,
    is_compressed: bool,
}

impl Encoder {
    pub(super) fn new(form: StoredForm) -> Self {
        Self { form, values: Vec::new(), stored: Vec::new(), size: 0, is_compressed: false }
    }

    /// Writes `rows` from row `first` on, but for the last, which is left in `last`.
    pub(super) fn append(
        &mut self,
        dataset: &Dataset,
        first: usize,
        rows: &[u8],
        row_bytes: usize,
        last: &mut LastRow,
    ) -> Result<()> {
        for (row, values) in (first..).zip(rows.chunks_exact(row_bytes)) {
            last.replace(dataset, row, self.stored_row(values))?;
        }
        Ok(())
    }

    /// A row as it is stored: as it is where compression would make it no smaller.
    fn stored_row(&mut self, values: &[u8]) -> EncodedRow<'_> {
        if !(self.form.repeats && self.size > 0 && self.values == values) {
            self.encode_anew(values);
        }
        EncodedRow { bytes: &self.stored[..self.size], is_compressed: self.is_compressed }
    }

    fn encode_anew(&mut self, values: &[u8]) {
        let Self { form, values: known, stored, size, is_compressed } = self;
        stored.resize(values.len() + checksum::BYTES, 0);
        *size = ffi::compress(form.level, form.shuffle, values, &mut stored[..values.len()]);
        *is_compressed = *size > 0;
        if !*is_compressed {
            *size = values.len();
            stored[..*size].copy_from_slice(values);
        }
        let checksum = checksum::fletcher32(&stored[..*size]);
        stored[*size..][..checksum::BYTES].copy_from_slice(&checksum.to_le_bytes());
        *size += checksum::BYTES;
        if form.repeats {
            known.clear();
            known.extend_from_slice(values);
        }
    }
}

impl RowEncoder for Encoder {
    fn encode(&mut self, row: &[u8], out: &mut EncodedRows) {
        out.push(self.stored_row(row));
    }
}

/// The last row of a column whose rows are written as they are stored. The library keeps a row that it is given until the next one comes
/// or the file is flushed, and only then finds a place for it in the file. So does this: the copy of a file is equal to the
/// file that was recorded in one go in every byte.
#[derive(Debug, Default)]
pub(super) struct LastRow {
    row: usize,
    stored: Vec<u8>,
    /// Whether `stored` is compressed, or the values themselves; a checksum follows either.
    is_compressed: bool,
}

impl LastRow {
    /// Writes rows from `first` on, but for the last.
    pub(super) fn append(&mut self, dataset: &Dataset, first: usize, rows: &EncodedRows) -> Result<()> {
        for (index, stored) in rows.iter().enumerate() {
            self.replace(dataset, first + index, stored)?;
        }
        Ok(())
    }

    /// Writes the row, as it is, if there is one, and keeps another in its place.
    fn replace(&mut self, dataset: &Dataset, row: usize, stored: EncodedRow<'_>) -> Result<()> {
        self.write(dataset)?;
        self.row = row;
        self.is_compressed = stored.is_compressed;
        self.stored.extend_from_slice(stored.bytes);
        Ok(())
    }

    /// Writes the row, as it is, if there is one.
    pub(super) fn write(&mut self, dataset: &Dataset) -> Result<()> {
        if !self.stored.is_empty() {
            ffi::write_row(dataset, self.row, &self.stored, self.is_compressed).map_err(library_error)?;
            self.stored.clear();
        }
        Ok(())
    }

    /// Gives the library the values of the row, if there is one.
    pub(super) fn hand_over(&mut self, dataset: &Dataset, field: &Field) -> Result<()> {
        let mut stored = mem::take(&mut self.stored);
        if let Some((bytes, _)) = stored.split_last_chunk::<{ checksum::BYTES }>() {
            let mut values = vec![0; field.dim()];
            if self.is_compressed {
                let mut scratch = blosc::Scratch::default();
                let decoded = blosc::decode(bytes, values.len(), 0..values.len(), &mut values, &mut scratch);
                decoded.map_err(|reason| invalid(format!("its chunk is {reason}")))?;
            } else {
                values.copy_from_slice(bytes);
            }
            library::write(dataset, field, self.row, 1, Slice::U8(&values))?;
        }
        stored.clear();
        self.stored = stored;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use swm_core::Metadata;

    use super::*;
    use crate::formats::hdf5::create;

    const SIDE: usize = 40;
    const ROW: usize = SIDE * SIDE * 3;

    /// Rows that compress well, two equal ones, one that does not compress, a constant one.
    fn rows() -> Vec<u8> {
        let noise = |at: usize| (at as u32).wrapping_mul(2_654_435_761).rotate_left(at as u32 % 31) as u8;
        let smooth = |row: usize| (0..ROW).map(move |at| (at / 97 * (row + 1)) as u8);
        let rows = smooth(0).chain(smooth(1)).chain(smooth(1)).chain((0..ROW).map(noise));
        rows.chain(smooth(3)).chain(smooth(3)).chain([7; ROW]).collect()
    }

    /// A file with one column, written as `write` does.
    fn file(kind: FieldKind, write: impl FnOnce(&Dataset, &Field)) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let field = Field { kind, ..Field::step("image", Dtype::U8, &[SIDE, SIDE, 3]) };
        let handles = create::create(&path, std::slice::from_ref(&field), &Metadata::default()).unwrap();
        create::set_rows(&handles.columns[0], rows().len() / ROW).unwrap();
        write(&handles.columns[0], &field);
        handles.close().unwrap();
        fs::read(path).unwrap()
    }

    #[test]
    fn rows_are_encoded_as_the_library_encodes_them() {
        for kind in [FieldKind::Step, FieldKind::Episode] {
            let by_library = file(kind, |dataset, field| {
                library::write(dataset, field, 0, rows().len() / ROW, Slice::U8(&rows())).unwrap();
            });
            for pieces in [1, 3] {
                let by_encoder = file(kind, |dataset, field| {
                    let mut encoder = Encoder::new(StoredForm::of(dataset, field).unwrap().unwrap());
                    let mut last = LastRow::default();
                    for (index, rows) in rows().chunks(pieces * ROW).enumerate() {
                        encoder.append(dataset, index * pieces, rows, ROW, &mut last).unwrap();
                    }
                    last.hand_over(dataset, field).unwrap();
                });
                assert!(by_encoder == by_library, "{kind:?}, in pieces of {pieces} rows");
            }
            let encoded = file(kind, |dataset, field| {
                let mut encoder = Encoder::new(StoredForm::of(dataset, field).unwrap().unwrap());
                let (mut last, mut encoded) = (LastRow::default(), EncodedRows::default());
                rows().chunks(ROW).for_each(|row| encoder.encode(row, &mut encoded));
                last.append(dataset, 0, &encoded).unwrap();
                last.hand_over(dataset, field).unwrap();
            });
            assert!(encoded == by_library, "{kind:?}, encoded before");
        }
    }
}
