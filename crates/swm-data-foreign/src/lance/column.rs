//! A column of a table: numbers, texts, or files of images.

use std::sync::Arc;

use swm_core::{Dtype, Field, SliceMut};
use swm_data::dataset::Steps;
use swm_data::element::{Element, from_bytes};
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_lance::{Column, Cursor, Kind, Table, Values};

use super::of_lance;
use crate::array::{Array, Scratch, new_key};
use crate::encoded;

/// Bytes of numbers that are read at once, rows of images, and of texts.
const PIECE_BYTES: usize = 4 << 20;
const PIECE_IMAGES: usize = 32;
const PIECE_TEXTS: usize = 1 << 12;
/// Rows in which the first image is looked for.
const LOOKED_AT: u64 = 16;
/// The most values of a row.
const MAX_DIM: usize = 1 << 28;

/// What the rows of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    Numbers(Element),
    Text,
    /// Several texts, in JSON.
    Texts,
    /// JPEG or PNG.
    Images,
}

/// A column.
#[derive(Debug)]
pub(super) struct TableColumn {
    table: Arc<Table>,
    column: Column,
    what: What,
    dtype: Dtype,
    shape: Vec<usize>,
    rows: usize,
    key: usize,
}

/// How numbers of a type are stored.
pub(super) fn element(kind: &Kind) -> Option<Element> {
    Some(match kind {
        Kind::Bool => Element::Bool,
        Kind::Int { bits: 8, signed: false } => Element::U8,
        Kind::Int { bits: 16, signed: false } => Element::U16,
        Kind::Int { bits: 32, signed: false } => Element::U32,
        Kind::Int { bits: 64, signed: false } => Element::U64,
        Kind::Int { bits: 8, .. } => Element::I8,
        Kind::Int { bits: 16, .. } => Element::I16,
        Kind::Int { bits: 32, .. } => Element::I32,
        Kind::Int { bits: 64, .. } => Element::I64,
        Kind::Float { bits: 16 } => Element::F16,
        Kind::Float { bits: 32 } => Element::F32,
        Kind::Float { bits: 64 } => Element::F64,
        _ => return None,
    })
}

/// Numbers of a column that is an index.
pub(super) fn integers(kind: &Kind, bytes: &[u8]) -> Result<Vec<i64>> {
    let wrong = || wrong_type(format!("its values are {kind}, and not integers"));
    let element = element(kind).filter(|_| matches!(kind, Kind::Int { .. })).ok_or_else(wrong)?;
    let size = element.size().ok_or_else(wrong)?;
    let mut column = swm_core::Column::zeros(element.dtype(), bytes.len() / size);
    from_bytes(element, bytes, column.as_slice_mut())?;
    let slice = column.as_slice();
    // All have at most 53 bits, or are compared as what they are.
    match slice {
        swm_core::Slice::I64(values) => Ok(values.to_vec()),
        swm_core::Slice::I32(values) => Ok(values.iter().map(|&value| value.into()).collect()),
        swm_core::Slice::U8(values) => Ok(values.iter().map(|&value| value.into()).collect()),
        _ => Err(wrong()),
    }
}

/// The type and shape of rows; those of one value have none, as the reference stores single numbers.
fn shaped(kind: &Kind) -> Result<(What, Dtype, Vec<usize>)> {
    let mut shape = Vec::new();
    let mut item = kind;
    while let Kind::Fixed(inner, width) = item {
        shape.push(*width);
        item = inner;
    }
    if shape == [1] {
        shape.clear();
    }
    match item {
        Kind::Text => Ok((What::Text, Dtype::Str, shape)),
        Kind::Binary => Ok((What::Images, Dtype::U8, shape)),
        Kind::List(_) => {
            Err(unsupported(format!("its rows are a {kind}, and a column has rows of one shape")))
        }
        item => {
            let element =
                element(item).ok_or_else(|| unsupported(format!("its values are of type {item}")))?;
            Ok((What::Numbers(element), element.dtype(), shape))
        }
    }
}

impl TableColumn {
    /// A column of the reference, or of another program.
    pub(super) fn of(table: &Arc<Table>, column: &Column) -> Result<Self> {
        let (what, dtype, shape) = shaped(&column.kind)?;
        let mut found = Self::new(table, column, (what, dtype, shape))?;
        if what == What::Images {
            found.shape = found.image_shape()?.to_vec();
        }
        Ok(found)
    }

    /// A column that this package recorded.
    pub(super) fn recorded(table: &Arc<Table>, column: &Column, field: &Field) -> Result<Self> {
        let (what, _, stored) = shaped(&column.kind)?;
        let dim = field.shape.iter().try_fold(1usize, |dim, &size| dim.checked_mul(size));
        let dim = dim
            .filter(|&dim| dim <= MAX_DIM)
            .ok_or_else(|| invalid(format!("it has the shape {:?}", field.shape)))?;
        let stored: usize = stored.iter().product();
        let (what, is_it) = match (what, field.dtype) {
            // Bits are bytes there.
            (What::Numbers(Element::U8), Dtype::Bool) => (What::Numbers(Element::Bool), stored == dim),
            (What::Numbers(element), dtype) => (what, element.dtype() == dtype && stored == dim),
            (What::Text, Dtype::Str) => (if field.shape.is_empty() { What::Text } else { What::Texts }, true),
            (What::Images, Dtype::U8) => (what, field.shape.len() == 3),
            _ => (what, false),
        };
        match is_it {
            true => Self::new(table, column, (what, field.dtype, field.shape.clone())),
            false => Err(wrong_type(format!("its rows are {}, and its record has {field:?}", column.kind))),
        }
    }

    fn new(
        table: &Arc<Table>,
        column: &Column,
        (what, dtype, shape): (What, Dtype, Vec<usize>),
    ) -> Result<Self> {
        let rows = usize::try_from(table.rows()).map_err(|_| invalid("it has too many rows"))?;
        Ok(Self { table: table.clone(), column: column.clone(), what, dtype, shape, rows, key: new_key() })
    }

    /// The shape of the images, by the first one.
    fn image_shape(&self) -> Result<[usize; 3]> {
        let mut cursor = Cursor::default();
        for row in 0..self.table.rows().min(LOOKED_AT) {
            let values = self.table.read(&self.column, row, 1, &mut cursor).map_err(of_lance)?;
            match values.item(0).filter(|_| values.is_valid(0)) {
                None => {}
                Some(file) => return encoded::shape(file),
            }
        }
        Err(unsupported("its first rows have no images"))
    }

    fn fill(&self, values: &Values, mut out: SliceMut<'_>) -> Result<()> {
        let dim = self.dim();
        match self.what {
            What::Numbers(element) => {
                if values.numbers().len() != out.len() * element.size().unwrap_or(0) {
                    return Err(invalid(format!(
                        "{} bytes of values are too few or too many",
                        values.numbers().len()
                    )));
                }
                from_bytes(element, values.numbers(), out.reborrow())?;
                if !values.is_complete() {
                    for item in (0..out.len()).filter(|&item| !values.is_item_valid(item)) {
                        let (_, rest) = out.reborrow().split_at(item);
                        rest.split_at(1).0.fill_missing();
                    }
                }
                Ok(())
            }
            What::Text | What::Texts => {
                let SliceMut::Str(out) = out else { return Err(wrong_type("it has texts")) };
                for (row, out) in out.chunks_exact_mut(dim).enumerate() {
                    let text = std::str::from_utf8(values.item(row).unwrap_or_default())
                        .map_err(FormatError::other)?;
                    match (self.what, out) {
                        (What::Text, [out]) => text.clone_into(out),
                        (_, out) => {
                            let texts: Vec<String> = serde_json::from_str(text)?;
                            if texts.len() != out.len() {
                                return Err(invalid(format!(
                                    "{} texts instead of {}",
                                    texts.len(),
                                    out.len()
                                )));
                            }
                            out.iter_mut().zip(texts).for_each(|(out, text)| *out = text);
                        }
                    }
                }
                Ok(())
            }
            What::Images => {
                let (SliceMut::U8(out), &[height, width, colors]) = (out, &self.shape[..]) else {
                    return Err(wrong_type("images hold bytes"));
                };
                let shape = [height, width, colors];
                for (row, out) in out.chunks_exact_mut(dim).enumerate() {
                    let file = values.item(row).filter(|_| values.is_valid(row));
                    let file = file.ok_or_else(|| missing("an image is missing"))?;
                    encoded::decode(file, shape, out)?;
                }
                Ok(())
            }
        }
    }
}

impl Array for TableColumn {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn is_u64(&self) -> bool {
        self.what == What::Numbers(Element::U64)
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let (dim, mut done) = (self.dim(), 0);
        let most = match (self.what, rows.stride) {
            (_, 2..) => 1,
            (What::Images, _) => PIECE_IMAGES,
            (What::Text | What::Texts, _) => PIECE_TEXTS,
            _ => (PIECE_BYTES / (dim * 8).max(1)).max(1),
        };
        let cursor: &mut Cursor = scratch.part((self.key, 0), |_| Ok((Cursor::default(), 0)))?;
        while done < rows.count {
            let (count, first) = (most.min(rows.count - done), rows.first + done * rows.stride);
            let values = self.table.read(&self.column, first as u64, count, cursor).map_err(of_lance)?;
            let (here, rest) = out.split_at(count * dim);
            self.fill(&values, here).at(format_args!("from row {first} of the table on"))?;
            (out, done) = (rest, done + count);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_numbers_have_no_shape() {
        let f32s = |width| Kind::Fixed(Box::new(Kind::Float { bits: 32 }), width);
        let shape = |kind: &Kind| shaped(kind).map(|(_, dtype, shape)| (dtype, shape));
        assert_eq!(shape(&f32s(1)).unwrap(), (Dtype::F32, vec![]));
        assert_eq!(shape(&f32s(3)).unwrap(), (Dtype::F32, vec![3]));
        assert_eq!(shape(&Kind::Fixed(Box::new(f32s(2)), 4)).unwrap(), (Dtype::F32, vec![4, 2]));
        assert_eq!(shape(&Kind::Int { bits: 32, signed: false }).unwrap(), (Dtype::I64, vec![]));
        assert!(shape(&Kind::List(Box::new(Kind::Bool))).unwrap_err().is_unsupported());
    }
}
