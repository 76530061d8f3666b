//! Settings with ranges, read by name: several groups share one flat list.

use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{Setting, Settings};

use crate::error::PlanError;

/// Settings with ranges: what solvers, plans and costs are configured with.
pub trait Validate: Settings {
    /// Checks the ranges.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`], which names the first that is out of range.
    fn validate(&self) -> Result<(), PlanError>;

    /// Reads settings by name; what is not given has its default.
    ///
    /// # Errors
    ///
    /// [`PlanError::Setting`]: unknown, of another type, or out of range.
    fn from_settings(mut given: Map<String, Json>) -> Result<Self, PlanError> {
        let settings = take::<Self>(&mut given)?;
        refuse_rest(&given, Self::SETTINGS)?;
        Ok(settings)
    }
}

/// Takes the settings of one group, by their present and former names, out of `given`.
pub(crate) fn take_named(
    given: &mut Map<String, Json>,
    settings: &[Setting],
    renamed: &[(&str, &str)],
) -> Result<Map<String, Json>, PlanError> {
    for &(old, new) in renamed {
        if let Some(value) = given.shift_remove(old)
            && given.insert(new.to_owned(), value).is_some()
        {
            return Err(PlanError::setting(
                old,
                format!("is the former name of `{new}`, which is given too"),
            ));
        }
    }
    Ok(settings.iter().filter_map(|setting| given.shift_remove_entry(setting.name)).collect())
}

/// Takes the settings of `T` out of `given`, so that several groups can share one flat list.
pub(crate) fn take<T: Validate>(given: &mut Map<String, Json>) -> Result<T, PlanError> {
    let own = take_named(given, T::SETTINGS, T::RENAMED)?;
    let settings: T = serde_json::from_value(Json::Object(own.clone())).map_err(|error| {
        // The message of a misfit value does not name its field: look for the one that fails alone.
        let fails = |(name, value): (&String, &Json)| {
            let one = Map::from_iter([(name.clone(), value.clone())]);
            serde_json::from_value::<T>(Json::Object(one)).err().map(|e| (name.clone(), e.to_string()))
        };
        let (name, reason) =
            own.iter().find_map(fails).unwrap_or_else(|| ("?".to_owned(), error.to_string()));
        PlanError::Setting { name, reason }
    })?;
    settings.validate()?;
    Ok(settings)
}

/// An error if anything is left in `given` that no group took; `known` are the names to choose from.
pub(crate) fn refuse_rest(given: &Map<String, Json>, known: &[Setting]) -> Result<(), PlanError> {
    let Some(name) = given.keys().next() else { return Ok(()) };
    let names: Vec<&str> = known.iter().map(|setting| setting.name).collect();
    let near = nearest(name, names.iter().copied());
    let reason = format!("unknown{}; known are {}", did_you_mean(near.as_deref()), names.join(", "));
    Err(PlanError::setting(name, reason))
}
