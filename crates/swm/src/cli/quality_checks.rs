//! What `swm quality` is asked for and cannot be: told before anything is measured.

use swm_core::error::{did_you_mean, nearest};
use swm_core::evaluate::Violation;
use swm_core::{Batch, EnvSpec, Field};

use super::output::counted;
use super::{Failure, usage};
use crate::evaluation::ProbeTarget;

/// Refuses a horizon that the model, which predicts `stride` steps at a time, cannot reach.
pub(super) fn check_horizon(horizon: usize, stride: usize) -> Result<(), Failure> {
    if horizon.is_multiple_of(stride) {
        return Ok(());
    }
    let near = (horizon / stride).max(1) * stride;
    Err(usage(format!(
        "--horizon {horizon}: the model predicts {stride} steps at a time; use --horizon {near}, or another multiple of {stride}"
    )))
}

/// Refuses a horizon that is longer than every episode.
pub(super) fn check_lengths(horizon: usize, recorded: &[Batch]) -> Result<(), Failure> {
    let longest = recorded.iter().map(Batch::rows).max().unwrap_or(0);
    if longest > horizon {
        return Ok(());
    }
    let longest = counted(longest, "step");
    Err(usage(format!(
        "--horizon {horizon}: the longest episode has {longest}; use a shorter horizon, or longer episodes"
    )))
}

/// Refuses a name that is neither a factor nor `teleport`, and elements that no episode can start from.
pub(super) fn check_violation(violation: &Violation, env: &EnvSpec) -> Result<(), Failure> {
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
    let lists = format!("`swm fovs {}` lists them", env.id);
    Err(usage(format!("--violation {name}: it is neither teleport nor a factor{meant}; {lists}")))
}

/// Refuses elements of a column that an episode cannot be made to start with.
fn check_set(env: &EnvSpec, column: &str, elements: &[usize], values: usize) -> Result<(), Failure> {
    let wrong = |reason: String| Err(usage(format!("--violation {column}{elements:?}=…: {reason}")));
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
pub(super) fn check_probe(target: &ProbeTarget, recorded: &[Batch]) -> Result<(), Failure> {
    let Some(schema) = recorded.first().map(Batch::schema) else { return Ok(()) };
    if schema.index(&target.column).is_some() {
        let first = &recorded[0];
        return target.values(first).map(drop).map_err(|reason| usage(format!("--probe {reason}")));
    }
    let columns: Vec<&str> = schema.fields().iter().map(|field| field.name.as_str()).collect();
    let meant = did_you_mean(nearest(&target.column, columns.iter().copied()).as_deref());
    Err(usage(format!("--probe {target}: unknown column{meant}; there are: {}", columns.join(", "))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn horizons_fit_the_model_and_the_episodes() {
        let told = |result: Result<(), Failure>| result.map_err(|wrong| (wrong.exit_code(), wrong.reason()));
        assert_eq!(told(check_horizon(10, 5)), Ok(()));
        let (status, reason) = told(check_horizon(7, 5)).unwrap_err();
        assert!(status == 2 && reason.contains("use --horizon 5, or another multiple of 5"), "{reason}");
        let (_, reason) = told(check_horizon(3, 5)).unwrap_err();
        assert!(reason.contains("use --horizon 5"), "{reason}");
        let schema = swm_core::Schema::new(Vec::new()).unwrap();
        let episodes = [4, 8].map(|rows| Batch::new(schema.clone(), rows));
        assert_eq!(told(check_lengths(7, &episodes)), Ok(()));
        let (status, reason) = told(check_lengths(8, &episodes)).unwrap_err();
        assert!(status == 2 && reason.contains("the longest episode has 8 steps"), "{reason}");
    }
}
