//! Columns of the core as NumPy arrays and back, by moving or copying their values.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{IxDyn, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyList;
use swm::core::{Column, Dtype, Field};

/// What a column is in Python.
type Array<'py> = Bound<'py, PyAny>;

/// An array of `shape` that takes the values over without a copy; text becomes a flat list of `str`.
pub(crate) fn into_array<'py>(py: Python<'py>, column: Column, shape: &[usize]) -> PyResult<Array<'py>> {
    macro_rules! array {
        ($values:ident) => {
            PyArray1::from_vec(py, $values).reshape(IxDyn(shape))?.into_any()
        };
    }
    Ok(match column {
        Column::Bool(values) => array!(values),
        Column::U8(values) => array!(values),
        Column::I32(values) => array!(values),
        Column::I64(values) => array!(values),
        Column::F32(values) => array!(values),
        Column::F64(values) => array!(values),
        Column::Str(values) => PyList::new(py, values)?.into_any(),
    })
}

/// The values of an array in the order of C; `None` where they lie otherwise in memory. (`as_slice` of the crate takes the order of
/// Fortran, too, and gives the values of a transposed array as they lie.)
pub(crate) fn c_slice<'a, T: numpy::Element>(array: &'a PyReadonlyArrayDyn<'_, T>) -> Option<&'a [T]> {
    array.is_c_contiguous().then(|| array.as_slice().ok()).flatten()
}

/// A copy of the values of a C-contiguous array or a list of `str`, and the array's shape.
pub(crate) fn from_array(name: &str, array: &Array<'_>) -> PyResult<(Column, Vec<usize>)> {
    macro_rules! column {
        ($($variant:ident: $type:ty),*) => {
            $(if let Ok(array) = array.cast::<PyArrayDyn<$type>>() {
                let shape = array.shape().to_vec();
                let values = array.try_readonly().map_err(|error| refused(name, &error.to_string()))?;
                let values = c_slice(&values).ok_or_else(|| refused(name, "its values are not in the order of C"))?;
                return Ok((Column::$variant(values.to_vec()), shape));
            })*
        };
    }
    column!(Bool: bool, U8: u8, I32: i32, I64: i64, F32: f32, F64: f64);
    match array.extract::<Vec<String>>() {
        Ok(texts) => {
            let len = texts.len();
            Ok((Column::Str(texts), vec![len]))
        }
        Err(_) => Err(PyTypeError::new_err(format!(
            "column `{name}` has a type that datasets cannot hold; use bool, uint8, int32, int64, float32, float64 or \
             a list of str"
        ))),
    }
}

fn refused(name: &str, reason: &str) -> PyErr {
    PyValueError::new_err(format!("column `{name}`: {reason}; use np.ascontiguousarray"))
}

/// The step field of a column with values of `shape`, `[rows, …]`.
pub(crate) fn step_field(name: &str, column: &Column, shape: &[usize]) -> Field {
    Field::step(name, column.dtype(), &shape[1.min(shape.len())..])
}

/// `(name, dtype, shape, kind)` of a field, as Python reads it.
pub(crate) fn describe(field: &Field) -> (String, &'static str, Vec<usize>, &'static str) {
    let kind = match field.kind {
        swm::core::FieldKind::Step => "step",
        swm::core::FieldKind::Episode => "episode",
    };
    let dtype = match field.dtype {
        Dtype::Str => "str",
        dtype => dtype.name(),
    };
    (field.name.clone(), dtype, field.shape.clone(), kind)
}

/// Locks what a panic cannot have left half changed.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
