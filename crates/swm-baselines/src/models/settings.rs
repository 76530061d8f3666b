//! From a preset and changed settings to a model's own settings struct; what all of them check.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use crate::error::BaselineError;

/// `preset` with `changes` laid over it, object by object. Unknown settings are errors.
pub(crate) fn with_changes<C: Serialize + DeserializeOwned>(
    baseline: &'static str,
    preset: &C,
    changes: &Json,
) -> Result<C, BaselineError> {
    let wrong = |error: serde_json::Error| BaselineError::Settings { baseline, reason: error.to_string() };
    let mut settings = serde_json::to_value(preset).map_err(wrong)?;
    lay_over(&mut settings, changes);
    serde_json::from_value(settings).map_err(wrong)
}

/// What is wrong with sizes that must be at least 1, and with a share of dropout, if anything is.
pub(crate) fn check_sizes(sizes: &[(&str, usize)], dropout: f64) -> Result<(), String> {
    if let Some((name, _)) = sizes.iter().find(|(_, size)| *size == 0) {
        return Err(format!("`{name}` is 0; it must be at least 1"));
    }
    if !(0.0..1.0).contains(&dropout) {
        return Err(format!("`predictor.dropout` is {dropout}; it must be in [0, 1)"));
    }
    Ok(())
}

fn lay_over(under: &mut Json, over: &Json) {
    match (under, over) {
        (_, Json::Null) => {}
        // An encoder of another kind replaces the old one: their settings have nothing in common.
        (Json::Object(under), Json::Object(over))
            if under.get("kind").is_none_or(|kind| over.get("kind").is_none_or(|other| other == kind)) =>
        {
            for (name, value) in over {
                match under.get_mut(name) {
                    Some(old) if old.is_object() => lay_over(old, value),
                    _ => {
                        under.insert(name.clone(), value.clone());
                    }
                }
            }
        }
        (under, over) => *under = over.clone(),
    }
}
