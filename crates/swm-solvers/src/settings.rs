//! Settings with ranges, read by name: several groups share one flat list.

use serde_json::{Map, Value as Json};
use swm_core::settings::{WrongSetting, read};
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
    let mut own = take_named(given, T::SETTINGS, T::RENAMED)?;
    follow_samples(&mut own, T::SETTINGS);
    let settings: T = read(&own)?;
    settings.validate()?;
    Ok(settings)
}

/// An error if anything is left in `given` that no group took; `known` are the names to choose from.
pub(crate) fn refuse_rest(given: &Map<String, Json>, known: &[Setting]) -> Result<(), PlanError> {
    let Some(name) = given.keys().next() else { return Ok(()) };
    Err(WrongSetting::unknown(name, known.iter().map(|setting| setting.name)).into())
}

/// Where there are fewer samples than elites by default, half of the samples are elites: 2 or more, if there are as many samples.
fn follow_samples(given: &mut Map<String, Json>, known: &[Setting]) {
    let default = known.iter().find(|setting| setting.name == "elites");
    let Some(default) = default.and_then(|setting| setting.default.parse::<u64>().ok()) else { return };
    if let Some(samples) = given.get("samples").and_then(Json::as_u64)
        && samples < default
        && !given.contains_key("elites")
    {
        given.insert("elites".to_owned(), (samples / 2).max(2).min(samples).into());
    }
}
