//! NumPy arrays that show the columns of a World in place: no copies, read-only, valid for as long as anyone holds them.
//!
//! Every array has a [`Table`] as its base, which keeps the World alive. Where the World replaces its infos (another
//! policy, the end), the old columns move into the `Table` of the arrays that show them.

use std::sync::{Arc, Mutex};

use numpy::ndarray::{ArrayViewD, IxDyn};
use numpy::{Element, PyArrayDyn};
use pyo3::prelude::*;
use swm::core::{Batch, Slice};

use crate::world::{Core, Shared};

/// The owner of the memory behind the arrays of one infos table.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
pub(crate) struct Table {
    world: Arc<Shared>,
    /// The columns, once the World has other ones.
    kept: Mutex<Option<Batch>>,
}

impl Table {
    /// The owner of the present infos of `world`.
    pub(crate) fn new(world: Arc<Shared>) -> Self {
        Self { world, kept: Mutex::new(None) }
    }

    /// Takes over the columns that the World has replaced.
    pub(crate) fn keep(&self, replaced: Batch) {
        *self.kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(replaced);
    }
}

/// A name and the array of its column.
pub(crate) type Named<'py> = (String, Bound<'py, PyAny>);

/// The columns of the World's infos as arrays `(N, 1, …)`, but for texts.
///
/// `core` is that of the World that `table` belongs to.
pub(crate) fn infos<'py>(table: &Bound<'py, Table>, core: &Core) -> PyResult<Vec<Named<'py>>> {
    let Some(world) = &core.world else { return Ok(Vec::new()) };
    let infos = world.infos();
    let mut named = Vec::new();
    for (index, field) in infos.schema().fields().iter().enumerate() {
        let shape: Vec<usize> = [infos.rows(), 1].iter().chain(&field.shape).copied().collect();
        if let Some(array) = view(table, infos.column(index), &shape, false)? {
            named.push((field.name.clone(), array));
        }
    }
    mirror(table, core, true, &mut named)?;
    Ok(named)
}

/// What the last step gave, as arrays `(N,)`; see [`infos`].
pub(crate) fn results<'py>(table: &Bound<'py, Table>, core: &Core) -> PyResult<Vec<Named<'py>>> {
    let mut named = Vec::new();
    mirror(table, core, false, &mut named)?;
    Ok(named)
}

/// The columns that the binding keeps itself: those of the infos, `(N, 1, …)`, or the results of a step, `(N,)`.
fn mirror<'py>(
    table: &Bound<'py, Table>,
    core: &Core,
    of_infos: bool,
    named: &mut Vec<Named<'py>>,
) -> PyResult<()> {
    let rows = table.get().world.num_envs;
    for column in core.mirror.columns().into_iter().filter(|column| column.is_info == of_infos) {
        let leading: &[usize] = if of_infos { &[rows, 1] } else { &[rows] };
        let shape: Vec<usize> = leading.iter().chain(column.shape).copied().collect();
        if let Some(array) = view(table, column.values, &shape, column.is_flag)? {
            named.push((column.name.to_owned(), array));
        }
    }
    Ok(())
}

/// A column as an array; `None` for texts. `is_flag`: bytes that are 0 or 1, shown as booleans.
fn view<'py>(
    table: &Bound<'py, Table>,
    column: Slice<'_>,
    shape: &[usize],
    is_flag: bool,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    Ok(Some(match column {
        Slice::U8(values) if is_flag => array(table, values.as_ptr().cast::<bool>(), shape),
        Slice::U8(values) => array(table, values.as_ptr(), shape),
        Slice::I32(values) => array(table, values.as_ptr(), shape),
        Slice::I64(values) => array(table, values.as_ptr(), shape),
        Slice::F32(values) => array(table, values.as_ptr(), shape),
        Slice::F64(values) => array(table, values.as_ptr(), shape),
        Slice::Bool(values) => array(table, values.as_ptr(), shape),
        Slice::Str(_) => return Ok(None),
    }?))
}

fn array<'py, T: Element>(
    table: &Bound<'py, Table>,
    values: *const T,
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    // SAFETY: `values` is the start of a column of `shape` values (a table has as many rows and values as its schema says),
    // which is initialized and lives at this address until the table is dropped: columns of the infos and of the mirror are
    // written in place and never resized. The array's base is the `Table`, which holds the World, and which is given the
    // columns where the World replaces them. While the core writes, Python is detached from this World: what another thread
    // reads then is as undetermined as in any array that two threads share, and its memory is there.
    let shown = unsafe { ArrayViewD::from_shape_ptr(IxDyn(shape), values) };
    // SAFETY: as above; the base outlives the array.
    let array = unsafe { PyArrayDyn::borrow_from_array(&shown, table.clone().into_any()) }.into_any();
    // The core records these values, and reads some bytes as booleans: nobody else writes there.
    array.call_method1("setflags", (false,))?;
    Ok(array)
}
