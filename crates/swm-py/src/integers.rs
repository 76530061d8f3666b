//! Integer arguments: one that does not fit is refused with the argument's name and its bounds.

use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;

use crate::errors::SwmError;

/// Integers of a type, or several of them.
trait Integer: Sized {
    /// Those of the argument `name`.
    fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self>;
}

macro_rules! integers {
    ($($type:ty)*) => {$(
        impl Integer for $type {
            fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
                value.extract().map_err(|error: PyErr| match error.is_instance_of::<PyOverflowError>(value.py()) {
                    true => SwmError::new_err(format!(
                        "{name}={value}: give a whole number from {} to {}",
                        <$type>::MIN,
                        <$type>::MAX
                    )),
                    false => error,
                })
            }
        }
    )*};
}

integers!(u32 u64 usize);

impl<T: Integer> Integer for Option<T> {
    fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        if value.is_none() { Ok(None) } else { T::read(name, value).map(Some) }
    }
}

impl<T: Integer> Integer for Vec<T> {
    fn read(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        value.try_iter()?.map(|one| T::read(name, &one?)).collect()
    }
}

/// Functions for `from_py_with`, each by the name that its argument has in Python.
macro_rules! arguments {
    ($($name:ident: $type:ty)*) => {$(
        /// Reads the argument of this name.
        pub(crate) fn $name(value: &Bound<'_, PyAny>) -> PyResult<$type> {
            Integer::read(stringify!($name), value)
        }
    )*};
}

arguments! {
    checkpoints: Option<u32>
    epoch: u64
    episode: usize
    episodes: Vec<usize>
    frame_skip: u32
    frameskip: usize
    index: usize
    indices: Vec<usize>
    key_frame_period: Option<u32>
    limit: Option<u64>
    max_episode_steps: Option<u64>
    num_envs: usize
    num_steps: usize
    plan_steps: Option<u64>
    seed: u64
    seeds: Option<Vec<Option<u64>>>
    start: usize
    stop: usize
    threads: Option<usize>
}
