//! Rows through the HDF5 library, which knows every filter, layout and element type; slower than the chunk table
//! and under the library's global lock. Both directions: what is read here can be anything, what is written is ours.

use hdf5_metno::types::FixedUnicode;
use hdf5_metno::{Dataset, H5Type, Hyperslab, SliceOrIndex};
use ndarray::{ArrayD, ArrayViewD, IxDyn};
use swm_core::{Field, Slice, SliceMut};

use super::handles::library_error;
use super::layout::TEXT_BYTES;
use crate::dataset::Steps;
use crate::error::{At as _, FormatError, Result, invalid, unsupported, wrong_type};
use crate::formats::element::{self, Element};

/// What is said of texts of any length that only the library could find: on a damaged heap its way has no bound.
pub(super) const TEXT: &str = "text of any length is not read in such chunks or with such filters; store it without filters, and a row in \
                               one chunk";

/// The same of attributes.
pub(super) const UNCOMMON: &str = "text of any length is not read from a file whose addresses are not of 8 bytes and count from its begin; write it with the library's defaults";

/// What is said of texts of fixed length that only the library could read.
pub(super) const FIXED_TEXT: &str =
    "compressed text of fixed length is not read; store it as text of any length";

/// Reads rows, counted over the whole file, into `out`.
pub(super) fn read(
    dataset: &Dataset,
    element: Element,
    field: &Field,
    rows: Steps,
    out: SliceMut<'_>,
) -> Result<()> {
    let selection = || selection(field, rows);
    match (element, out) {
        // As numbers: a foreign file can hold other values than 0 and 1.
        (Element::Bool, SliceMut::Bool(out)) => fill(dataset, selection(), out, |value: u8| Ok(value != 0)),
        (Element::Text | Element::AsciiText, _) => Err(unsupported(TEXT)),
        (Element::FixedText(_), _) => Err(unsupported("compressed text of fixed length is not supported")),
        // The library would give the nearest i64.
        (Element::U64, SliceMut::I64(out)) => fill(dataset, selection(), out, element::signed),
        (_, SliceMut::U8(out)) => fill(dataset, selection(), out, Ok::<u8, _>),
        (_, SliceMut::I32(out)) => fill(dataset, selection(), out, Ok::<i32, _>),
        (_, SliceMut::I64(out)) => fill(dataset, selection(), out, Ok::<i64, _>),
        (_, SliceMut::F32(out)) => fill(dataset, selection(), out, Ok::<f32, _>),
        (_, SliceMut::F64(out)) => fill(dataset, selection(), out, Ok::<f64, _>),
        (element, out) => Err(wrong_type(format!("{element:?} elements were asked for as {}", out.dtype()))),
    }
}

/// Writes `count` rows from row `first` on; the dataset is long enough.
pub(super) fn write(
    dataset: &Dataset,
    field: &Field,
    first: usize,
    count: usize,
    values: Slice<'_>,
) -> Result<()> {
    let selection = selection(field, Steps { first, count, stride: 1 });
    let mut shape = vec![count];
    shape.extend(&field.shape);
    match values {
        Slice::Bool(values) => put(dataset, selection, &shape, values),
        Slice::U8(values) => put(dataset, selection, &shape, values),
        Slice::I32(values) => put(dataset, selection, &shape, values),
        Slice::I64(values) => put(dataset, selection, &shape, values),
        Slice::F32(values) => put(dataset, selection, &shape, values),
        Slice::F64(values) => put(dataset, selection, &shape, values),
        Slice::Str(values) => {
            let texts: Vec<_> = values.iter().map(|text| fixed(text)).collect::<Result<_, _>>()?;
            put(dataset, selection, &shape, &texts)
        }
    }
}

/// Text as it is stored.
fn fixed(text: &str) -> Result<FixedUnicode<TEXT_BYTES>> {
    if text.len() > TEXT_BYTES {
        return Err(element::long_text(text.len(), TEXT_BYTES, "bytes"));
    }
    if text.contains('\0') {
        return Err(invalid("a text contains the character NUL"));
    }
    text.parse().map_err(FormatError::other).at("a text")
}

fn selection(field: &Field, rows: Steps) -> Hyperslab {
    let rows = SliceOrIndex::SliceCount { start: rows.first, step: rows.stride, count: rows.count, block: 1 };
    let whole = |&size: &usize| SliceOrIndex::SliceCount { start: 0, step: 1, count: size, block: 1 };
    let axes: Vec<_> = [rows].into_iter().chain(field.shape.iter().map(whole)).collect();
    axes.into()
}

fn fill<S: H5Type, T>(
    dataset: &Dataset,
    selection: Hyperslab,
    out: &mut [T],
    value: impl Fn(S) -> Result<T>,
) -> Result<()> {
    let array: ArrayD<S> = dataset.read_slice(selection).map_err(library_error)?;
    if array.len() != out.len() {
        return Err(wrong_type(format!("{} values instead of {}", array.len(), out.len())));
    }
    for (target, stored) in out.iter_mut().zip(array) {
        *target = value(stored)?;
    }
    Ok(())
}

fn put<T: H5Type>(dataset: &Dataset, selection: Hyperslab, shape: &[usize], values: &[T]) -> Result<()> {
    let view = ArrayViewD::from_shape(IxDyn(shape), values).map_err(FormatError::other)?;
    dataset.write_slice(view, selection).map_err(library_error)
}
