//! Tables whose memory Rust and Python share: batches lent to NumPy, and tables over arrays that Python owns.

use std::sync::{Arc, Mutex};

use numpy::ndarray::{ArrayViewMutD, IxDyn};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString};
use swm::core::{Batch, Column, Dtype, RowsMut, Schema, SliceMut};
use swm::data::loader::Table;

use crate::arrays::lock;

/// Batches that nobody views, to be filled again.
#[derive(Default)]
pub(crate) struct Pool(Mutex<Vec<Batch>>);

impl Pool {
    /// More than these are given back to the system.
    const SPARE: usize = 4;

    /// A table to be filled.
    pub(crate) fn take(&self) -> Option<Batch> {
        lock(&self.0).pop()
    }

    /// Keeps a table for the next batch.
    pub(crate) fn put(&self, batch: Batch) {
        let mut spare = lock(&self.0);
        if spare.len() < Self::SPARE {
            spare.push(batch);
        }
    }
}

/// The owner of a batch that NumPy arrays view. When the last of them is gone, the batch goes back to its pool.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm", name = "_Lent")]
struct Lent {
    /// Never touched while this object lives: the views have it for themselves.
    batch: Mutex<Option<Batch>>,
    pool: Arc<Pool>,
}

impl Drop for Lent {
    fn drop(&mut self) {
        if let Some(batch) = lock(&self.batch).take() {
            self.pool.put(batch);
        }
    }
}

/// Views of all columns of a batch, `[rows, …shape]`, by name; text becomes a list with the first text of every row.
pub(crate) fn lend<'py>(
    py: Python<'py>,
    mut batch: Batch,
    pool: &Arc<Pool>,
    names: &[Py<PyString>],
) -> PyResult<Bound<'py, PyDict>> {
    /// Where the values of a column are, for the time after the batch has moved into its owner.
    enum Place {
        Bool(*mut bool),
        U8(*mut u8),
        I32(*mut i32),
        I64(*mut i64),
        F32(*mut f32),
        F64(*mut f64),
        Str(Vec<String>),
    }
    let schema = batch.schema().clone();
    let rows = batch.rows();
    let mut places = Vec::with_capacity(names.len());
    for column in 0..schema.fields().len() {
        let dim = schema.dim(column).max(1);
        places.push(match batch.column_mut(column) {
            SliceMut::Bool(values) => Place::Bool(values.as_mut_ptr()),
            SliceMut::U8(values) => Place::U8(values.as_mut_ptr()),
            SliceMut::I32(values) => Place::I32(values.as_mut_ptr()),
            SliceMut::I64(values) => Place::I64(values.as_mut_ptr()),
            SliceMut::F32(values) => Place::F32(values.as_mut_ptr()),
            SliceMut::F64(values) => Place::F64(values.as_mut_ptr()),
            SliceMut::Str(values) => Place::Str(values.iter().step_by(dim).cloned().collect()),
        });
    }
    let owner = Bound::new(py, Lent { batch: Mutex::new(Some(batch)), pool: pool.clone() })?.into_any();
    let dict = PyDict::new(py);
    for ((place, field), name) in places.into_iter().zip(schema.fields()).zip(names) {
        let shape: Vec<usize> = std::iter::once(rows).chain(field.shape.iter().copied()).collect();
        // SAFETY: each pointer is that of a column of the batch in `owner`, of this type and of `rows × dim` values. Its
        // memory neither moves nor is used until `owner` is dropped.
        let array = unsafe {
            match place {
                Place::Bool(values) => view(values, &shape, &owner),
                Place::U8(values) => view(values, &shape, &owner),
                Place::I32(values) => view(values, &shape, &owner),
                Place::I64(values) => view(values, &shape, &owner),
                Place::F32(values) => view(values, &shape, &owner),
                Place::F64(values) => view(values, &shape, &owner),
                Place::Str(texts) => PyList::new(py, texts)?.into_any(),
            }
        };
        dict.set_item(name, array)?;
    }
    Ok(dict)
}

/// An array of `shape` over values that `owner` holds.
///
/// # Safety
///
/// There are as many values as the shape says. They stay where they are, and nobody else uses them, until `owner` is
/// dropped.
unsafe fn view<'py, T: Element>(
    values: *mut T,
    shape: &[usize],
    owner: &Bound<'py, PyAny>,
) -> Bound<'py, PyAny> {
    // SAFETY: as the caller promises.
    let array = unsafe { ArrayViewMutD::from_shape_ptr(IxDyn(shape), values) };
    // SAFETY: as the caller promises; the array keeps `owner` alive.
    unsafe { PyArrayDyn::borrow_from_array(&array, owner.clone()) }.into_any()
}

/// A column and its texts, one per row.
type Texts = (String, Vec<String>);

/// A table over arrays that Python made for it, such as torch's pinned tensors. Texts it keeps itself.
pub(crate) struct ForeignTable {
    schema: Arc<Schema>,
    rows: usize,
    capacity: usize,
    columns: Vec<Place>,
    /// What keeps the arrays alive, and is given back with them.
    owner: Py<PyAny>,
}

enum Place {
    Foreign(*mut u8, Dtype),
    Own(Column),
}

// SAFETY: the pointers are those of arrays that `owner` keeps alive; whoever has the table has them for himself, as
// the arrays were made for it and are handed out with it.
unsafe impl Send for ForeignTable {}

impl ForeignTable {
    /// A table for at most `capacity` rows over `arrays`, one `[capacity, …shape]` per column but texts. Nobody may use
    /// the arrays before they are given out.
    pub(crate) fn new(
        schema: &Arc<Schema>,
        capacity: usize,
        arrays: &Bound<'_, PyDict>,
        owner: Py<PyAny>,
    ) -> PyResult<Self> {
        let mut columns = Vec::with_capacity(schema.fields().len());
        for field in schema.fields() {
            let shape: Vec<usize> = std::iter::once(capacity).chain(field.shape.iter().copied()).collect();
            let array = || {
                let found = arrays.get_item(&field.name)?;
                found.ok_or_else(|| PyValueError::new_err(format!("no array for column `{}`", field.name)))
            };
            columns.push(match field.dtype {
                Dtype::Str => Place::Own(Column::zeros(Dtype::Str, 0)),
                Dtype::Bool => {
                    let values = pointer::<bool>(&field.name, &shape, &array()?)?;
                    // SAFETY: `pointer` has checked that there are as many values; 0 is `false`. New arrays may hold
                    // bytes that no `bool` is.
                    unsafe { values.write_bytes(0, shape.iter().product()) };
                    Place::Foreign(values.cast(), Dtype::Bool)
                }
                Dtype::U8 => Place::Foreign(pointer::<u8>(&field.name, &shape, &array()?)?, Dtype::U8),
                Dtype::I32 => {
                    Place::Foreign(pointer::<i32>(&field.name, &shape, &array()?)?.cast(), Dtype::I32)
                }
                Dtype::I64 => {
                    Place::Foreign(pointer::<i64>(&field.name, &shape, &array()?)?.cast(), Dtype::I64)
                }
                Dtype::F32 => {
                    Place::Foreign(pointer::<f32>(&field.name, &shape, &array()?)?.cast(), Dtype::F32)
                }
                Dtype::F64 => {
                    Place::Foreign(pointer::<f64>(&field.name, &shape, &array()?)?.cast(), Dtype::F64)
                }
            });
        }
        Ok(Self { schema: schema.clone(), rows: 0, capacity, columns, owner })
    }

    /// What Python gave with the arrays, the number of rows that are filled, and texts by column.
    pub(crate) fn into_parts(self) -> (Py<PyAny>, usize, Vec<Texts>) {
        let fields = self.schema.fields().iter();
        let texts = fields.zip(self.columns).filter_map(|(field, place)| match place {
            Place::Own(Column::Str(values)) => {
                Some((field.name.clone(), values.into_iter().step_by(field.dim().max(1)).collect()))
            }
            _ => None,
        });
        let texts = texts.collect();
        (self.owner, self.rows, texts)
    }
}

/// Where the values of an array are, if it has this shape and type, is contiguous and writable.
fn pointer<T: Element>(name: &str, shape: &[usize], array: &Bound<'_, PyAny>) -> PyResult<*mut T> {
    let array = array
        .cast::<PyArrayDyn<T>>()
        .map_err(|_| PyTypeError::new_err(format!("the array of column `{name}` has another type")))?;
    if array.shape() != shape || !array.is_c_contiguous() {
        let found = array.shape();
        return Err(PyValueError::new_err(format!(
            "the array of column `{name}` has shape {found:?}; it must be contiguous, of shape {shape:?}"
        )));
    }
    // The exclusive borrow proves that it is writable, the slice that it is aligned.
    let refused = |error: &dyn std::fmt::Display| PyValueError::new_err(format!("column `{name}`: {error}"));
    let mut values = array.try_readwrite().map_err(|error| refused(&error))?;
    Ok(values.as_slice_mut().map_err(|error| refused(&error))?.as_mut_ptr())
}

/// A table of either kind, as one loader's.
pub(crate) enum AnyTable {
    /// Memory of the core.
    Own(Batch),
    /// Memory of Python.
    Foreign(ForeignTable),
}

impl Table for AnyTable {
    fn schema(&self) -> &Schema {
        match self {
            Self::Own(batch) => batch.schema(),
            Self::Foreign(table) => &table.schema,
        }
    }

    fn resize(&mut self, rows: usize) {
        match self {
            Self::Own(batch) => batch.resize(rows),
            Self::Foreign(table) => {
                assert!(rows <= table.capacity, "{rows} rows of a table for {}", table.capacity);
                for (place, field) in table.columns.iter_mut().zip(table.schema.fields()) {
                    if let Place::Own(column) = place {
                        column.resize(rows * field.dim());
                    }
                }
                table.rows = rows;
            }
        }
    }

    fn rows_mut(&mut self) -> RowsMut<'_> {
        match self {
            Self::Own(batch) => batch.rows_mut(),
            Self::Foreign(ForeignTable { schema, rows, columns, .. }) => {
                let slices = columns.iter_mut().zip(schema.fields()).map(|(place, field)| match place {
                    Place::Own(column) => column.as_slice_mut(),
                    Place::Foreign(values, dtype) => {
                        let len = *rows * field.dim();
                        // SAFETY: `new` has checked that the array has `capacity × dim` values of this type, and
                        // `resize` that there are no more rows. The table is borrowed exclusively, and with it the
                        // arrays.
                        unsafe {
                            match dtype {
                                Dtype::Bool => SliceMut::Bool(slice(*values, len)),
                                Dtype::U8 => SliceMut::U8(slice(*values, len)),
                                Dtype::I32 => SliceMut::I32(slice(*values, len)),
                                Dtype::I64 => SliceMut::I64(slice(*values, len)),
                                Dtype::F32 => SliceMut::F32(slice(*values, len)),
                                Dtype::F64 => SliceMut::F64(slice(*values, len)),
                                Dtype::Str => SliceMut::Str(&mut []),
                            }
                        }
                    }
                });
                RowsMut::over(schema, *rows, slices).expect("the arrays were checked against the schema")
            }
        }
    }
}

/// `len` values at `values`.
///
/// # Safety
///
/// There are so many values of this type, aligned, and nobody else uses them for the lifetime.
unsafe fn slice<'a, T>(values: *mut u8, len: usize) -> &'a mut [T] {
    // SAFETY: as the caller promises. NumPy aligns its arrays to their elements.
    unsafe { std::slice::from_raw_parts_mut(values.cast(), len) }
}
