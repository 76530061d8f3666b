//! Inputs of environments and their checks: actions, and starts and goals from recorded rows.

use std::collections::BTreeMap;

use swm_core::batch::Element;
use swm_core::{BatchError, Dtype, EnvError, EnvSpec, Slice, Value};

/// The values of an action: `dim` finite ones.
pub(crate) fn finite_values<T: Element>(action: Slice<'_>, dim: usize) -> Result<&[T], EnvError> {
    let values = action.get().filter(|values: &&[T]| values.len() == dim && action.is_finite());
    values.ok_or_else(|| {
        let expected = format!("{dim} finite {} values", T::DTYPE);
        let found = format!("{} values of {}: {action:?}", action.len(), action.dtype());
        BatchError::WrongValue { name: "action".to_owned(), expected, found }.into()
    })
}

/// The values of a column, if the row has it.
pub(crate) fn recorded(
    env: &str,
    row: &BTreeMap<String, Value>,
    name: &str,
    dim: usize,
) -> Result<Option<Vec<f64>>, EnvError> {
    let Some(value) = row.get(name) else { return Ok(None) };
    let values = value.cast(name, Dtype::F64, &[dim])?.to_f64s(name)?;
    if values.iter().any(|value| !value.is_finite()) {
        return Err(refused(env, format!("the recorded `{name}` is not finite")));
    }
    Ok(Some(values))
}

/// Copies a column that a start can do without, if the row has it in this size.
pub(crate) fn recall(row: &BTreeMap<String, Value>, name: &str, out: &mut [f64]) {
    let values = row.get(name).and_then(|value| value.to_f64s(name).ok());
    if let Some(values) = values.filter(|values| values.len() == out.len()) {
        out.copy_from_slice(&values);
    }
}

/// As [`recorded`], of a column that a start or a goal (`what`) cannot do without.
pub(crate) fn needed(
    env: &str,
    row: &BTreeMap<String, Value>,
    what: &str,
    name: &str,
    dim: usize,
) -> Result<Vec<f64>, EnvError> {
    let values = recorded(env, row, name, dim)?;
    values.ok_or_else(|| refused(env, format!("a {what} needs the column `{name}`")))
}

/// Refuses a goal with columns that cannot be one.
pub(crate) fn check_goal(spec: &EnvSpec, row: &BTreeMap<String, Value>) -> Result<(), EnvError> {
    match row.keys().find(|column| !spec.goal_columns.contains(&column.as_str())) {
        Some(column) => Err(refused(&spec.id, format!("`{column}` is no goal of this environment"))),
        None => Ok(()),
    }
}

fn refused(env: &str, reason: String) -> EnvError {
    EnvError::Reset { env: env.to_owned(), reason }
}
