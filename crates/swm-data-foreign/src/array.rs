//! Arrays of other programs' files: rows of one type and shape, wherever they are stored, and arrays that are made of others.

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use swm_core::{Column, Dtype, SliceMut};
use swm_data::dataset::{Steps, copy_rows};
use swm_data::element::is_not_utf8;
use swm_data::error::{FormatError, Result, invalid, unsupported, wrong_type};
use swm_data::hdf5;

/// Rows of one type and shape.
pub(super) trait Array: Send + Sync + fmt::Debug {
    fn dtype(&self) -> Dtype;

    fn rows(&self) -> usize;

    /// Of one row.
    fn shape(&self) -> &[usize];

    /// Reads rows that exist into `out`, which fits.
    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()>;

    /// Whether the file has numbers of u64, of which some may be none of the i64 that columns hold.
    fn is_u64(&self) -> bool {
        false
    }

    /// Whether the file has encoded images, which are decoded.
    fn is_encoded(&self) -> bool {
        false
    }

    /// Values of a row.
    fn dim(&self) -> usize {
        self.shape().iter().product()
    }
}

pub(super) type Shared = Arc<dyn Array>;

/// Why texts of other programs that are none are not read.
pub(super) const NO_TEXT: &str = "its values are bytes and no text (UTF-8), for which there are no columns; store them as u8, or leave them out";

/// An error of reading: texts that are none are sound bytes of another program.
pub(super) fn of_other_program(error: FormatError) -> FormatError {
    if is_not_utf8(&error) { unsupported(NO_TEXT) } else { error }
}

/// All values of some rows.
pub(super) fn values(array: &dyn Array, rows: Steps, scratch: &mut Scratch) -> Result<Column> {
    if rows.end().is_none_or(|end| end > array.rows()) {
        return Err(invalid(format!(
            "it has {} rows, not {} from {} on",
            array.rows(),
            rows.count,
            rows.first
        )));
    }
    let mut column = Column::zeros(array.dtype(), rows.count * array.dim());
    array.read(rows, column.as_slice_mut(), scratch)?;
    Ok(column)
}

/// All values as numbers, of an array that is an index or a mark.
pub(super) fn numbers(array: &dyn Array, scratch: &mut Scratch) -> Result<Vec<f64>> {
    let column = values(array, Steps { first: 0, count: array.rows(), stride: 1 }, scratch)?;
    let value = |index| column.as_slice().as_f64(index);
    let values: Option<Vec<f64>> = (0..column.len()).map(value).collect();
    values.ok_or_else(|| wrong_type(format!("it holds {}, not numbers", column.dtype())))
}

/// What one handle keeps between reads.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) hdf5: hdf5::Scratch,
    pub(super) bytes: Vec<u8>,
    held: Vec<Held>,
}

/// A decoded part of a file.
struct Held {
    key: (usize, usize),
    bytes: usize,
    part: Box<dyn Any + Send>,
}

/// Bytes of decoded parts that a handle keeps; the newest is always kept.
const HELD_BYTES: usize = 64 << 20;

impl Scratch {
    /// A part of an array that was decoded before, or is now: `make` returns it and its bytes.
    pub(super) fn part<T: Any + Send>(
        &mut self,
        key: (usize, usize),
        make: impl FnOnce(&mut Self) -> Result<(T, usize)>,
    ) -> Result<&mut T> {
        match self.held.iter().position(|held| held.key == key) {
            Some(at) => {
                let held = self.held.remove(at);
                self.held.push(held);
            }
            None => {
                let (part, bytes) = make(self)?;
                self.held.push(Held { key, bytes, part: Box::new(part) });
                while self.held.len() > 1
                    && self.held.iter().map(|held| held.bytes).sum::<usize>() > HELD_BYTES
                {
                    self.held.remove(0);
                }
            }
        }
        let last = self.held.last_mut().and_then(|held| held.part.downcast_mut());
        last.ok_or_else(|| invalid("a part was decoded as another type"))
    }
}

/// A number that tells the parts of one array from those of all others.
pub(super) fn new_key() -> usize {
    static NEXT: AtomicUsize = AtomicUsize::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// Values in memory.
#[derive(Debug)]
pub(super) struct Memory {
    values: Column,
    shape: Vec<usize>,
}

impl Memory {
    pub(super) fn of(values: Column, shape: &[usize]) -> Shared {
        Arc::new(Self { values, shape: shape.to_vec() })
    }

    /// One mark a row.
    pub(super) fn marks(marks: Vec<bool>) -> Shared {
        Self::of(Column::Bool(marks), &[])
    }
}

impl Array for Memory {
    fn dtype(&self) -> Dtype {
        self.values.dtype()
    }

    fn rows(&self) -> usize {
        self.values.len() / self.dim().max(1)
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, _scratch: &mut Scratch) -> Result<()> {
        copy_rows(self.values.as_slice(), self.dim(), rows, out);
        Ok(())
    }
}

/// The same values in every row.
#[derive(Debug)]
pub(super) struct Constant {
    pub(super) value: Column,
    pub(super) rows: usize,
}

impl Array for Constant {
    fn dtype(&self) -> Dtype {
        self.value.dtype()
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn shape(&self) -> &[usize] {
        &[]
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, _scratch: &mut Scratch) -> Result<()> {
        for _ in 0..rows.count {
            let (mut one, rest) = out.split_at(1);
            copy_rows(self.value.as_slice(), 1, Steps { first: 0, count: 1, stride: 1 }, one.reborrow());
            out = rest;
        }
        Ok(())
    }
}

/// Vectors of several arrays one behind the other, as f64, and of each only the first values if so told.
#[derive(Debug)]
pub(super) struct Joined {
    parts: Vec<(Shared, usize)>,
    shape: [usize; 1],
}

impl Joined {
    /// Of each array, so many values of a row.
    pub(super) fn of(parts: Vec<(Shared, usize)>) -> Result<Shared> {
        let shape = [parts.iter().map(|(_, width)| width).sum()];
        let rows = parts.first().map_or(0, |(array, _)| array.rows());
        for (array, width) in &parts {
            if array.rows() != rows || *width > array.dim() || !is_number(array.dtype()) {
                return Err(invalid(format!(
                    "its arrays differ: {} rows of {} {:?} and {rows} rows",
                    array.rows(),
                    array.dtype(),
                    array.shape()
                )));
            }
        }
        Ok(Arc::new(Self { parts, shape }))
    }
}

pub(super) fn is_number(dtype: Dtype) -> bool {
    !matches!(dtype, Dtype::Str | Dtype::Bool)
}

impl Array for Joined {
    fn dtype(&self) -> Dtype {
        Dtype::F64
    }

    fn rows(&self) -> usize {
        self.parts.first().map_or(0, |(array, _)| array.rows())
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let SliceMut::F64(out) = out else { return Err(wrong_type("it is of float64")) };
        let mut at = 0;
        for (array, width) in &self.parts {
            let (column, dim) = (values(array.as_ref(), rows, scratch)?, array.dim());
            for row in 0..rows.count {
                for value in 0..*width {
                    out[row * self.shape[0] + at + value] =
                        column.as_slice().as_f64(row * dim + value).unwrap_or(f64::NAN);
                }
            }
            at += width;
        }
        Ok(())
    }
}

/// Floats divided by a number.
#[derive(Debug)]
pub(super) struct Divided(pub(super) Shared, pub(super) f32);

impl Array for Divided {
    fn dtype(&self) -> Dtype {
        self.0.dtype()
    }

    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        self.0.read(rows, out.reborrow(), scratch)?;
        match out {
            SliceMut::F32(out) => out.iter_mut().for_each(|value| *value /= self.1),
            SliceMut::F64(out) => out.iter_mut().for_each(|value| *value /= f64::from(self.1)),
            out => return Err(wrong_type(format!("it holds {}, not floats", out.dtype()))),
        }
        Ok(())
    }
}

/// The type that holds all values of both, if there is one.
pub(super) fn common(a: Dtype, b: Dtype) -> Option<Dtype> {
    const INTEGERS: [Dtype; 3] = [Dtype::U8, Dtype::I32, Dtype::I64];
    const FLOATS: [Dtype; 2] = [Dtype::F32, Dtype::F64];
    if a == b {
        return Some(a);
    }
    let wider = |all: &[Dtype]| {
        let at = |wanted: Dtype| all.iter().position(|&dtype| dtype == wanted);
        Some(all[at(a)?.max(at(b)?)])
    };
    wider(&INTEGERS).or_else(|| wider(&FLOATS))
}

/// Numbers as those of a wider type.
#[derive(Debug)]
pub(super) struct Widened(pub(super) Shared, pub(super) Dtype);

impl Array for Widened {
    fn dtype(&self) -> Dtype {
        self.1
    }

    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    fn is_u64(&self) -> bool {
        self.0.is_u64()
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        widen(&values(self.0.as_ref(), rows, scratch)?, out)
    }
}

/// Fills `out` with numbers of another type, which is none that it does not hold.
pub(super) fn widen(from: &Column, mut out: SliceMut<'_>) -> Result<()> {
    macro_rules! fill {
        ($from:ident, $out:ident) => {
            $out.iter_mut().zip($from).for_each(|(out, &value)| *out = value.into())
        };
    }
    match (from, out.reborrow()) {
        (Column::U8(from), SliceMut::I32(out)) => fill!(from, out),
        (Column::U8(from), SliceMut::I64(out)) => fill!(from, out),
        (Column::I32(from), SliceMut::I64(out)) => fill!(from, out),
        (Column::F32(from), SliceMut::F64(out)) => fill!(from, out),
        (from, out) => {
            return Err(unsupported(format!(
                "its values are {} here, and {} in the first episode; store all in one type",
                from.dtype(),
                out.dtype()
            )));
        }
    }
    Ok(())
}

/// Rows of another shape: the values are the same.
#[derive(Debug)]
pub(super) struct Reshaped(pub(super) Shared, pub(super) Vec<usize>);

impl Array for Reshaped {
    fn dtype(&self) -> Dtype {
        self.0.dtype()
    }

    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn shape(&self) -> &[usize] {
        &self.1
    }

    fn is_u64(&self) -> bool {
        self.0.is_u64()
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        self.0.read(rows, out, scratch)
    }
}
