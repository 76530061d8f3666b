//! From a preset and changed settings to a model's own settings struct.

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
