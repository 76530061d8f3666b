//! From a preset and changed settings to a model's own settings struct; what all of them check.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::settings::plain;

use crate::error::BaselineError;

/// Settings that had another name before, which is still taken: the old name, and the new one.
const RENAMED: &[(&str, &str)] = &[("width", "dim"), ("width", "latent_dim"), ("head_width", "head_dim")];

/// `preset` with `changes` laid over it, object by object. Unknown settings, and values of another kind than the preset's, are
/// errors that name the setting.
pub(crate) fn with_changes<C: Serialize + DeserializeOwned>(
    baseline: &'static str,
    preset: &C,
    changes: &Json,
) -> Result<C, BaselineError> {
    let wrong = |reason| BaselineError::Settings { baseline, reason };
    let mut settings = serde_json::to_value(preset).map_err(|error| wrong(error.to_string()))?;
    lay_over(&mut settings, changes, "").map_err(wrong)?;
    serde_json::from_value(settings).map_err(|error| wrong(plain(&error.to_string())))
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

/// Lays `over` on the setting at `place`, such as `model.encoder`.
fn lay_over(under: &mut Json, over: &Json, place: &str) -> Result<(), String> {
    match (under, over) {
        (Json::Object(_), Json::Null) => Ok(()),
        // An encoder of another kind replaces the old one: their settings have nothing in common.
        (Json::Object(under), Json::Object(over))
            if under.get("kind").is_none_or(|kind| over.get("kind").is_none_or(|other| other == kind)) =>
        {
            for (name, value) in over {
                let renamed = RENAMED.iter().find(|(old, new)| old == name && under.contains_key(*new));
                let name = renamed.map_or(name.as_str(), |(_, new)| new);
                let inner = joined(place, name);
                if !under.contains_key(name) {
                    let known: Vec<&str> = under.keys().map(String::as_str).collect();
                    let near = nearest(name, known.iter().copied()).map(|near| joined(place, &near));
                    let meant = did_you_mean(near.or_else(|| path_to(name, under, place)).as_deref());
                    return Err(format!("`{inner}`: unknown{meant}; known are {}", known.join(", ")));
                }
                lay_over(&mut under[name], value, &inner)?;
            }
            Ok(())
        }
        (under, over) => {
            if let Some(wanted) = kind_of(under).filter(|_| !is_like(under, over)) {
                return Err(format!("`{place}` is {over}; it must be {wanted}"));
            }
            *under = over.clone();
            Ok(())
        }
    }
}

/// `optim.lr` of `optim` and `lr`.
fn joined(place: &str, name: &str) -> String {
    if place.is_empty() { name.to_owned() } else { format!("{place}.{name}") }
}

/// The path of the first setting `name` below `place`: who writes `lr` may mean `optim.lr`.
fn path_to(name: &str, settings: &Map<String, Json>, place: &str) -> Option<String> {
    settings.iter().find_map(|(key, value)| match (key == name, value) {
        (true, _) => Some(joined(place, key)),
        (false, Json::Object(inner)) => path_to(name, inner, &joined(place, key)),
        _ => None,
    })
}

/// What a setting must be, in words; `None` where the preset's value does not tell.
fn kind_of(setting: &Json) -> Option<&'static str> {
    match setting {
        Json::Bool(_) => Some("true or false"),
        Json::Number(number) if number.is_u64() => Some("a whole number, not below 0"),
        Json::Number(_) => Some("a number"),
        Json::Array(_) => Some("a list, such as [1,2]"),
        // Of objects and names some stand for each other: `schedule` is `constant`, or an object.
        Json::Object(_) | Json::String(_) => Some("a name or a group of settings"),
        Json::Null => None,
    }
}

fn is_like(old: &Json, new: &Json) -> bool {
    match old {
        Json::Bool(_) => new.is_boolean(),
        Json::Number(number) if number.is_u64() => new.is_u64(),
        // `null` turns a bound off.
        Json::Number(_) => new.is_number() || new.is_null(),
        Json::Array(_) => new.is_array(),
        Json::Object(_) | Json::String(_) => new.is_object() || new.is_string(),
        Json::Null => true,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::LewmConfig;

    #[test]
    fn unknown_settings_are_told_with_the_whole_name_of_the_nearest() {
        let told =
            |changes: Json| with_changes("lewm", &LewmConfig::paper(), &changes).unwrap_err().to_string();
        assert!(
            told(json!({ "optim": { "lrr": 0.1 } }))
                .contains("`optim.lrr`: unknown (did you mean `optim.lr`?)")
        );
        assert!(told(json!({ "lr": 0.1 })).contains("`lr`: unknown (did you mean `optim.lr`?)"));
    }

    #[test]
    fn settings_keep_their_old_names() {
        let named = |latent: &str, dim: &str, head: &str| {
            let encoder = json!({ "kind": "vit", dim: 24 });
            let changes = json!({ "model": { latent: 16, "encoder": encoder, "predictor": { head: 8 } } });
            with_changes("lewm", &LewmConfig::paper(), &changes).unwrap()
        };
        let config = named("latent_dim", "dim", "head_dim");
        assert_eq!(config, named("width", "width", "head_width"));
        let written = serde_json::to_string(&config).unwrap();
        let old = written.replace("\"head_dim\"", "\"head_width\"").replace("\"latent_dim\"", "\"width\"");
        let old = old.replace("\"dim\"", "\"width\"");
        assert_ne!(old, written);
        assert_eq!(serde_json::from_str::<LewmConfig>(&old).unwrap(), config);
    }
}
