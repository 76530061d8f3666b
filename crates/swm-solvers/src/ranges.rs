//! Checks of ranges that settings have in common, with errors that say what is allowed.

use crate::error::PlanError;

/// More samples or iterations are a typing error (and would not fit the keys of the noise).
const MAX_COUNT: usize = 10_000_000;

/// Longer horizons, blocks or histories are typing errors.
const MAX_LENGTH: usize = 100_000;

/// A length of a plan: from 1 to the most that can be intended.
pub(crate) fn check_length(name: &str, value: usize) -> Result<(), PlanError> {
    at_least_one(name, value)?;
    check_at_most(name, value, MAX_LENGTH)
}

/// 1 or more.
pub(crate) fn at_least_one(name: &str, value: usize) -> Result<(), PlanError> {
    if value == 0 { Err(PlanError::setting(name, "0 is too small; use 1 or more")) } else { Ok(()) }
}

/// At most `most`.
pub(crate) fn check_at_most(name: &str, value: usize, most: usize) -> Result<(), PlanError> {
    if value > most { Err(PlanError::setting(name, format!("{value} is more than {most}"))) } else { Ok(()) }
}

/// How many candidates and iterations: 1 or more of the first, 0 or more of the second.
pub(crate) fn check_counts(samples: usize, iterations: usize) -> Result<(), PlanError> {
    at_least_one("samples", samples)?;
    check_at_most("samples", samples, MAX_COUNT)?;
    check_at_most("iterations", iterations, MAX_COUNT)
}

/// How many of `samples` are elites: 2 or more, because a standard deviation is fitted to them.
pub(crate) fn check_elites(elites: usize, samples: usize) -> Result<(), PlanError> {
    if elites < 2 {
        let reason = format!("{elites} is too few; a standard deviation needs 2 or more");
        return Err(PlanError::setting("elites", reason));
    }
    check_at_most_samples(elites, samples)
}

/// No more elites than samples.
pub(crate) fn check_at_most_samples(elites: usize, samples: usize) -> Result<(), PlanError> {
    if elites > samples {
        let reason = format!("{elites} of {samples} samples; use fewer elites or more samples");
        return Err(PlanError::setting("elites", reason));
    }
    Ok(())
}

/// A number above 0 that plans can hold.
pub(crate) fn check_positive(name: &str, value: f64) -> Result<(), PlanError> {
    if value > 0.0 && value <= f64::from(f32::MAX) {
        return Ok(());
    }
    let reason = match value > 0.0 {
        true => too_large(value),
        false => format!("{value} is not a positive number; use a number above 0"),
    };
    Err(PlanError::setting(name, reason))
}

/// Why plans, whose values are f32, cannot hold `value`.
fn too_large(value: f64) -> String {
    format!("{value:?} is too large for plans, whose values are f32; use at most {:?}", f32::MAX)
}

/// 0 or more, and such that plans can hold it.
pub(crate) fn check_not_negative(name: &str, value: f64) -> Result<(), PlanError> {
    if (0.0..=f64::from(f32::MAX)).contains(&value) {
        return Ok(());
    }
    let reason = match value > 0.0 {
        true => too_large(value),
        false => format!("{value} is not a number from 0 on; use 0 or more"),
    };
    Err(PlanError::setting(name, reason))
}

/// From 0 to 1, 1 itself excluded.
pub(crate) fn check_below_one(name: &str, value: f64) -> Result<(), PlanError> {
    if (0.0..1.0).contains(&value) {
        return Ok(());
    }
    Err(PlanError::setting(name, format!("{value} is not a number from 0 to 1 (excluded)")))
}

/// From 0 to 1, both included.
pub(crate) fn check_fraction(name: &str, value: f64) -> Result<(), PlanError> {
    if (0.0..=1.0).contains(&value) {
        return Ok(());
    }
    Err(PlanError::setting(name, format!("{value} is not a number from 0 to 1")))
}
