//! What cannot be measured is refused before it is.

use serde_json::json;
use swm_core::error::{did_you_mean, nearest};
use swm_core::evaluate::Violation;
use swm_core::{Batch, EnvSpec, Field};

use super::wrong_probe;
use crate::evaluation::ProbeTarget;
use crate::request::{Fix, List, Message, TaskError};

/// Refuses a horizon that the model, which predicts `stride` steps at a time, cannot reach.
pub(super) fn check_horizon(horizon: usize, stride: usize) -> Result<(), TaskError> {
    if horizon.is_multiple_of(stride) {
        return Ok(());
    }
    let near = (horizon / stride).max(1) * stride;
    let text = format!("the model predicts {stride} steps at a time, and the horizon is a multiple of them");
    Err(Message::about("horizon", horizon, text).fix(Fix::set("horizon", near)).into())
}

/// Refuses a horizon that is longer than every episode.
pub(super) fn check_lengths(horizon: usize, recorded: &[Batch]) -> Result<(), TaskError> {
    let longest = recorded.iter().map(Batch::rows).max().unwrap_or(0);
    if longest > horizon {
        return Ok(());
    }
    let steps = if longest == 1 { "step" } else { "steps" };
    let text =
        format!("the longest episode has {longest} {steps}; use a shorter horizon, or longer episodes");
    Err(Message::about("horizon", horizon, text).into())
}

/// Refuses a name that is neither a factor nor `teleport`, and elements that no episode can start from.
pub(super) fn check_violation(violation: &Violation, env: &EnvSpec) -> Result<(), TaskError> {
    let name = match violation {
        Violation::Factor { name } => name,
        Violation::Set { column, elements, to } => return check_set(env, column, elements, to.len()),
        _ => return Ok(()),
    };
    let factors = || env.factors.iter().map(|factor| factor.name.as_str());
    if factors().any(|factor| factor == name) {
        return Ok(());
    }
    let meant = did_you_mean(nearest(name, factors().chain(["teleport"])).as_deref());
    let text = format!("it is neither teleport nor a factor{meant}");
    let fix = Fix::List(List::Factors(env.id.clone()));
    Err(Message::about("violation", json!([name]), text).fix(fix).into())
}

/// Refuses elements of a column that an episode cannot be made to start with.
fn check_set(env: &EnvSpec, column: &str, elements: &[usize], values: usize) -> Result<(), TaskError> {
    let wrong =
        |reason: String| Err(Message::about("violation", format!("{column}{elements:?}=…"), reason).into());
    if !env.start_columns.contains(&column) {
        let columns = env.start_columns.join("`, `");
        return wrong(format!("episodes of {} cannot start from that column, but from `{columns}`", env.id));
    }
    let dim = env.fields.iter().find(|field| field.name == column).map_or(0, Field::dim);
    if let Some(element) = elements.iter().find(|&&element| element >= dim) {
        return wrong(format!("no element {element}; `{column}` has {dim}, from 0"));
    }
    match elements.len() == values {
        true => Ok(()),
        false => wrong(format!("{values} value(s) for {} element(s)", elements.len())),
    }
}

/// Refuses to probe for a column or element that the episodes do not hold.
pub(super) fn check_probe(target: &ProbeTarget, recorded: &[Batch]) -> Result<(), TaskError> {
    let Some(first) = recorded.first() else { return Ok(()) };
    let schema = first.schema();
    if schema.index(&target.column).is_some() {
        return target.values(first).map(drop).map_err(|reason| wrong_probe(reason.to_string()).into());
    }
    let columns: Vec<&str> = schema.fields().iter().map(|field| field.name.as_str()).collect();
    let meant = did_you_mean(nearest(&target.column, columns.iter().copied()).as_deref());
    let text = format!("unknown column{meant}; there are: {}", columns.join(", "));
    Err(Message::about("probe", target.to_string(), text).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn horizons_fit_the_model_and_the_episodes() {
        let told = |result: Result<(), TaskError>| result.map_err(|wrong| wrong.to_string());
        assert_eq!(told(check_horizon(10, 5)), Ok(()));
        let reason = told(check_horizon(12, 5)).unwrap_err();
        assert!(reason.contains("the model predicts 5 steps at a time"), "{reason}");
        assert_eq!(check_horizon(12, 5).unwrap_err().fix(), Some(&Fix::set("horizon", 10)));
        assert_eq!(check_horizon(3, 5).unwrap_err().fix(), Some(&Fix::set("horizon", 5)));
        let schema = swm_core::Schema::new(Vec::new()).unwrap();
        let episodes = [4, 8].map(|rows| Batch::new(schema.clone(), rows));
        assert_eq!(told(check_lengths(7, &episodes)), Ok(()));
        let reason = told(check_lengths(8, &episodes)).unwrap_err();
        assert!(reason.contains("horizon=8: the longest episode has 8 steps"), "{reason}");
    }
}
