//! Between Python's values and the core's: actions, reset options, values of factors.

use std::collections::BTreeMap;

use numpy::{
    PyArrayDescrMethods as _, PyArrayDyn, PyArrayMethods as _, PyUntypedArray, PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use swm::core::error::{did_you_mean, nearest};
use swm::core::{Column, Dtype, EnvSpec, FactorSpec, ResetOptions, Value};
use swm::fov::color_values;

use crate::arrays::c_slice;
use crate::errors::{OrRaise as _, PolicyFault, SwmError};

/// Any array, number or list as a NumPy array in the order of C.
fn as_array<'py>(given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let numpy = given.py().import("numpy")?;
    // Tensors on another device say how they come to the CPU; those that need gradients are detached.
    let given = match given.hasattr("detach")? {
        true => given.call_method0("detach")?.call_method0("cpu")?,
        false => given.clone(),
    };
    let array: Bound<'py, PyUntypedArray> = numpy.call_method1("ascontiguousarray", (given,))?.cast_into()?;
    // What the core has no type of, as one that holds it: half and extended precision, other byte orders, u64.
    let (dtype, py) = (array.dtype(), array.py());
    let is_known = dtype.is_native_byteorder() != Some(false);
    let target = match (dtype.kind(), dtype.itemsize()) {
        (b'f', 4 | 8) | (b'i', _) | (b'u', 1 | 2 | 4) if is_known => return Ok(array),
        (b'f', 2 | 4) => numpy::dtype::<f32>(py),
        (b'f', _) => numpy::dtype::<f64>(py),
        (b'u', 8) if array.call_method0("max").is_ok_and(|max| max.extract::<i64>().is_err()) => {
            return Ok(array);
        }
        (b'i' | b'u', _) => numpy::dtype::<i64>(py),
        _ => return Ok(array),
    };
    Ok(array.call_method1("astype", (target,))?.cast_into()?)
}

/// The values of an array, in the order of C, as the type of the core that holds them; `None` for other kinds.
fn column(array: &Bound<'_, PyUntypedArray>) -> PyResult<Option<Column>> {
    let any = array.as_any();
    macro_rules! copy {
        ($($type:ty => $variant:ident as $target:ty),*) => {
            $(if let Ok(array) = any.cast::<PyArrayDyn<$type>>() {
                let array = array.try_readonly().map_err(|_| SwmError::new_err("the array is in use elsewhere"))?;
                let values = array.as_slice().map_err(|error| SwmError::new_err(error.to_string()))?;
                return Ok(Some(Column::$variant(values.iter().map(|&value| value as $target).collect())));
            })*
        };
    }
    copy!(f32 => F32 as f32, f64 => F64 as f64, i64 => I64 as i64, i32 => I64 as i64, u8 => U8 as u8, i16 => I64 as i64,
          i8 => I64 as i64, u16 => I64 as i64, u32 => I64 as i64);
    if let Ok(array) = any.cast::<PyArrayDyn<bool>>() {
        return Ok(Some(Column::Bool(array.readonly().as_slice()?.to_vec())));
    }
    Ok(None)
}

/// Whether an array has the shape `wanted`, sizes of 1 apart: as many values in another shape would be others' actions.
fn has_shape(found: &[usize], wanted: &[usize]) -> bool {
    let long = |shape: &[usize]| shape.iter().copied().filter(|&size| size != 1).collect::<Vec<_>>();
    found == wanted || long(found) == long(wanted)
}

/// Actions `(N, …)` of any real type, as the action space's type. Rows of environments that do not step may be NaN.
pub(crate) fn actions(spec: &EnvSpec, num_envs: usize, given: &Bound<'_, PyAny>) -> PyResult<Column> {
    let wanted = spec.action.dtype().unwrap_or(Dtype::F32);
    let shape: Vec<usize> = std::iter::once(num_envs).chain(spec.action.shape()).collect();
    let count: usize = shape.iter().product();
    let wrong = |found: String| {
        SwmError::new_err(format!(
            "actions must be numbers of shape {shape:?}{}, found {found}",
            if num_envs > 1 { ", one row per environment" } else { "" }
        ))
    };
    // The usual case without a detour: an array of the space's own type.
    if wanted == Dtype::F32
        && let Ok(array) = given.cast::<PyArrayDyn<f32>>()
        && let Ok(array) = array.try_readonly()
        && let Some(values) = c_slice(&array)
        && has_shape(array.shape(), &shape)
    {
        return Ok(Column::F32(values.to_vec()));
    }
    let array = as_array(given)?;
    let found = || format!("{} of shape {:?}", array.dtype(), array.shape());
    let values = column(&array)?.ok_or_else(|| wrong(found()))?;
    if !has_shape(array.shape(), &shape) {
        return Err(wrong(found()));
    }
    let values = values.as_slice();
    let numbers = (0..count).map(|index| values.as_f64(index).unwrap_or(f64::NAN));
    if wanted == Dtype::I64
        && let Some(part) = numbers.clone().find(|value: &f64| value.is_finite() && value.fract() != 0.0)
    {
        return Err(PolicyFault::new_err(format!(
            "the actions of `{}` are whole numbers, found {part}; round them, or give the number of an action",
            spec.id
        )));
    }
    Ok(match wanted {
        Dtype::F64 => Column::F64(numbers.collect()),
        // NaN is what an idle row may have; in another row, no space holds the number that it becomes.
        Dtype::I64 => {
            Column::I64(numbers.map(|value| if value.is_nan() { i64::MIN } else { value as i64 }).collect())
        }
        _ => Column::F32(numbers.map(|value| value as f32).collect()),
    })
}

/// A number, a list, an array or a tensor as a value of the core.
pub(crate) fn value(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(text) = given.cast::<PyString>() {
        return Ok(Value::scalar(text.to_string()));
    }
    let array = as_array(given)?;
    let wrong =
        || SwmError::new_err(format!("`{name}` must be a number or an array of numbers, found {given}"));
    let data = column(&array)?.ok_or_else(wrong)?;
    // `ascontiguousarray` gives scalars one dimension.
    let shape = if data.len() == 1 { Vec::new() } else { array.shape().to_vec() };
    Ok(Value { shape, data })
}

fn values(option: &str, given: &Bound<'_, PyAny>) -> PyResult<BTreeMap<String, Value>> {
    let given = given.cast::<PyDict>().map_err(|_| {
        SwmError::new_err(format!("the option `{option}` must be a dict of names and values, found {given}"))
    })?;
    given
        .iter()
        .map(|(name, given)| {
            let name: String = name.extract()?;
            let value = value(&name, &given)?;
            Ok((name, value))
        })
        .collect()
}

/// Values of factors from a dict, each checked against its factor's type and shape; choices also by name.
pub(crate) fn factors(spec: &EnvSpec, given: &Bound<'_, PyAny>) -> PyResult<BTreeMap<String, Value>> {
    let mut given = values("variation_values", given)?;
    for (name, value) in &mut given {
        if let Some(factor) = spec.factors.iter().find(|factor| factor.name == *name)
            && let Some(dtype) = factor.space.dtype()
        {
            if let Column::Str(texts) = &value.data {
                let text = texts.join(",");
                if let Some(choice) = factor.choice(&text) {
                    *value = Value::scalar(choice);
                } else if let Some(color) = color_values(&factor.space, name, &text)
                    .map_err(|reason| SwmError::new_err(format!("{name}={text:?}: {reason}")))?
                {
                    *value = Value::vector(&color.values);
                } else if dtype != Dtype::Str {
                    return Err(no_choice(factor, &text));
                }
            }
            let fitting = value.cast(name, dtype, &factor.space.shape()).or_raise()?;
            // As requests have them, so that a recording is the same from wherever it is asked for.
            *value = match dtype {
                Dtype::Str => fitting,
                _ => Value::vector(&fitting.to_f64s(name).or_raise()?),
            };
        }
    }
    Ok(given)
}

/// Why a text is no value of a factor.
fn no_choice(factor: &FactorSpec, text: &str) -> PyErr {
    let FactorSpec { name, choices, .. } = factor;
    SwmError::new_err(match choices.as_slice() {
        [] => format!("{name}={text:?}: give a number or an array of numbers"),
        choices => {
            let meant = did_you_mean(nearest(text, choices.iter().map(String::as_str)).as_deref());
            format!("{name}={text:?}: give a number or one of {}{meant}", choices.join(", "))
        }
    })
}

/// Reset options from a dict: `variation` (a list of names, groups, `"all"`), `variation_values`, `start` and `goal` (dicts
/// of columns), `goal_image`, `state` and `goal_state` (the column `state` of the two), and `goal_<column>`.
pub(crate) fn reset_options(spec: &EnvSpec, given: &Bound<'_, PyAny>) -> PyResult<ResetOptions> {
    let mut options = ResetOptions::default();
    if given.is_none() {
        return Ok(options);
    }
    let dict = given
        .cast::<PyDict>()
        .map_err(|_| SwmError::new_err(format!("reset options must be a dict, found {given}")))?;
    for (key, given) in dict.iter() {
        let key: String = key.extract()?;
        if given.is_none() {
            continue;
        }
        match key.as_str() {
            "variation" => {
                let names: Vec<String> = match given.extract::<String>() {
                    Ok(name) => vec![name],
                    Err(_) => given.try_iter()?.map(|name| name?.extract()).collect::<PyResult<_>>()?,
                };
                options = options.vary(&names);
            }
            "variation_values" => options.variation_values = factors(spec, &given)?,
            "start" => options.start.get_or_insert_default().extend(values(&key, &given)?),
            "goal" => options.goal.get_or_insert_default().extend(values(&key, &given)?),
            "goal_image" => options.goal_image = Some(value(&key, &given)?),
            key if spec.start_columns.contains(&key) => {
                options.start.get_or_insert_default().insert(key.to_owned(), value(key, &given)?);
            }
            key => match key.strip_prefix("goal_").filter(|column| spec.goal_columns.contains(column)) {
                Some(column) => {
                    options.goal.get_or_insert_default().insert(column.to_owned(), value(key, &given)?);
                }
                None => return Err(unknown_option(spec, key)),
            },
        }
    }
    Ok(options)
}

fn unknown_option(spec: &EnvSpec, key: &str) -> PyErr {
    let starts = spec.start_columns.iter().map(|column| (*column).to_owned());
    let goals = spec.goal_columns.iter().map(|column| format!("goal_{column}"));
    let known: Vec<String> = ["variation", "variation_values", "start", "goal", "goal_image"]
        .map(str::to_owned)
        .into_iter()
        .chain(starts)
        .chain(goals)
        .collect();
    SwmError::new_err(format!("`{}` has no reset option `{key}`; it has {}", spec.id, known.join(", ")))
}
