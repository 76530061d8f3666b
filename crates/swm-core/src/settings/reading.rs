//! Settings from what somebody wrote: what is wrong is said by the name of the setting, not in serde's words.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value as Json};

use super::Setting;
use crate::error::{did_you_mean, nearest};

/// Reads settings by name.
///
/// ```
/// #[derive(Debug, serde::Deserialize)]
/// #[serde(default, deny_unknown_fields)]
/// struct Descent {
///     iterations: usize,
/// }
/// # impl Default for Descent { fn default() -> Self { Self { iterations: 30 } } }
///
/// let read = |text: &str| swm_core::settings::read::<Descent>(&serde_json::from_str(text).unwrap());
/// assert_eq!(read(r#"{"iterations": 5}"#).unwrap().iterations, 5);
/// assert_eq!(
///     read(r#"{"iteration": 5}"#).unwrap_err().to_string(),
///     "setting `iteration`: unknown (did you mean `iterations`?); known are iterations"
/// );
/// assert_eq!(
///     read(r#"{"iterations": "few"}"#).unwrap_err().to_string(),
///     "setting `iterations`: must be a whole number, 0 or more; found string \"few\""
/// );
/// ```
///
/// # Errors
///
/// [`WrongSetting`]: the first that is unknown, or that is not what it must be.
pub fn read<T: DeserializeOwned>(given: &Map<String, Json>) -> Result<T, WrongSetting> {
    let parse = |given: Map<String, Json>| serde_json::from_value::<T>(Json::Object(given));
    let fails = |given: Map<String, Json>| parse(given).err().map(|error| error.to_string());
    parse(given.clone()).map_err(|error| {
        let said = error.to_string();
        if let Some((name, known)) = named(&said, "unknown field `") {
            // Of structs with a flattened group in them, serde does not list the fields.
            let is_listed = !known.is_empty() || said.ends_with("there are no fields");
            let unlisted = || WrongSetting { name: name.to_owned(), reason: UNKNOWN.to_owned() };
            return if is_listed { WrongSetting::unknown(name, known) } else { unlisted() };
        }
        if let Some((name, _)) = named(&said, "missing field `") {
            return WrongSetting { name: name.to_owned(), reason: "must be given".to_owned() };
        }
        // The message of a misfit value does not name its setting. It is the one that fails alone; where others must be given, the
        // one without which the message is another.
        let alone = |(name, value): &(&String, &Json)| {
            fails(Map::from_iter([((*name).clone(), (*value).clone())])).as_ref() == Some(&said)
        };
        let without = |(name, _): &(&String, &Json)| {
            let others = given.iter().filter(|(other, _)| other != name);
            fails(others.map(|(name, value)| (name.clone(), value.clone())).collect()).as_ref() != Some(&said)
        };
        let guilty = given.iter().find(alone).or_else(|| given.iter().find(without));
        let name = guilty.map_or("?", |(name, _)| name).to_owned();
        WrongSetting { name, reason: plain(&said) }
    })
}

/// As [`read`], where the names to choose from are those of a table: it may leave out what its type has for others.
///
/// # Errors
///
/// As of [`read`].
pub fn read_of<T: DeserializeOwned>(given: &Map<String, Json>, known: &[Setting]) -> Result<T, WrongSetting> {
    read(given).map_err(|wrong| match wrong.reason.starts_with(UNKNOWN) && given.contains_key(&wrong.name) {
        true => WrongSetting::unknown(&wrong.name, known.iter().map(|setting| setting.name)),
        false => wrong,
    })
}

/// How the reason begins where a name is wrong.
const UNKNOWN: &str = "unknown";

/// A setting is unknown, or has a value that it cannot have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("setting `{name}`: {reason}")]
pub struct WrongSetting {
    /// Its name, as it was given.
    pub name: String,
    /// What is wrong, and what is allowed.
    pub reason: String,
}

impl WrongSetting {
    /// None of the `known` ones: the reason tells the nearest, and all.
    pub fn unknown<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Self {
        let known: Vec<&str> = known.into_iter().collect();
        let reason = match known.as_slice() {
            [] => format!("{UNKNOWN}; there are no settings"),
            known => {
                let meant = did_you_mean(nearest(name, known.iter().copied()).as_deref());
                format!("{UNKNOWN}{meant}; known are {}", known.join(", "))
            }
        };
        Self { name: name.to_owned(), reason }
    }
}

/// What serde says of a wrong value, in the words of who wrote the value: without the names of Rust's types.
///
/// ```
/// let said = serde_json::from_str::<u32>("-3").unwrap_err().to_string();
/// assert_eq!(
///     swm_core::settings::plain(&said),
///     "must be a whole number, 0 or more; found integer `-3` at line 1 column 2"
/// );
/// ```
pub fn plain(said: &str) -> String {
    let (what, place) = match said.rfind(" at line ") {
        Some(at) => said.split_at(at),
        None => (said, ""),
    };
    let misfit = ["invalid type: ", "invalid value: "].iter().find_map(|start| what.strip_prefix(start));
    if let Some((found, expected)) = misfit.and_then(|rest| rest.rsplit_once(", expected ")) {
        return format!("must be {}; found {found}{place}", in_words(expected));
    }
    if let Some((value, known)) = named(what, "unknown variant `") {
        let meant = did_you_mean(nearest(value, known.iter().copied()).as_deref());
        let known: Vec<String> = known.iter().map(|value| format!("`{value}`")).collect();
        return format!("no value `{value}`{meant}; there are {}{place}", known.join(", "));
    }
    if let Some((name, known)) = named(what, "unknown field `") {
        let meant = did_you_mean(nearest(name, known.iter().copied()).as_deref());
        return format!("`{name}` is unknown{meant}{place}");
    }
    if let Some((name, _)) = named(what, "missing field `") {
        return format!("`{name}` is missing{place}");
    }
    if what.starts_with("data did not match any variant") {
        return format!("not a value that can be read here{place}");
    }
    said.to_owned()
}

/// The wrong name behind `start`, and the right ones behind "expected".
fn named<'a>(said: &'a str, start: &str) -> Option<(&'a str, Vec<&'a str>)> {
    let (name, rest) = said.strip_prefix(start)?.split_once('`')?;
    Some((name, rest.split('`').skip(1).step_by(2).collect()))
}

/// A type's name, or what serde calls it, for people.
fn in_words(expected: &str) -> String {
    match expected {
        "usize" | "u64" | "u32" | "u16" | "u8" => "a whole number, 0 or more".to_owned(),
        "isize" | "i64" | "i32" | "i16" | "i8" => "a whole number".to_owned(),
        "f64" | "f32" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" => "text".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "a group of settings".to_owned(),
        other => {
            let length = other.strip_prefix("an array of length ").or(other.strip_prefix("a tuple of size "));
            match length {
                Some(length) => format!("a list of {length} values"),
                None if other.starts_with("struct ") => "a group of settings".to_owned(),
                None => other.to_owned(),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize, PartialEq)]
    #[serde(rename_all = "lowercase")]
    enum Render {
        #[default]
        Exact,
        Fast,
    }

    crate::settings! {
        /// Settings of a test.
        struct Given {
            /// How many.
            count: u64 = 3,
            /// How much.
            share: f64 = 0.5,
            /// Whether.
            flag: bool = false,
            /// How.
            render: Render = Render::Exact => "exact",
            /// Where.
            at: [f64; 2] = [0.0; 2] => "[0, 0]",
        }
    }

    fn refused(given: Json) -> String {
        let Json::Object(given) = given else { panic!("settings are an object") };
        read::<Given>(&given).unwrap_err().to_string()
    }

    #[test]
    fn unknown_settings_are_told_with_the_nearest() {
        let all = "known are count, share, flag, render, at";
        assert_eq!(
            refused(json!({ "rendr": "fast" })),
            format!("setting `rendr`: unknown (did you mean `render`?); {all}")
        );
        assert_eq!(
            refused(json!({ "count": 1, "completely": 2 })),
            format!("setting `completely`: unknown; {all}")
        );
        assert_eq!(WrongSetting::unknown("x", []).to_string(), "setting `x`: unknown; there are no settings");
    }

    #[test]
    fn wrong_values_are_told_by_the_setting_and_what_it_must_be() {
        for (given, told) in [
            (
                json!({ "share": 1.0, "count": -1 }),
                "`count`: must be a whole number, 0 or more; found integer `-1`",
            ),
            (json!({ "share": "much" }), "`share`: must be a number; found string \"much\""),
            (json!({ "count": 1, "flag": 1 }), "`flag`: must be true or false; found integer `1`"),
            (
                json!({ "render": "fst" }),
                "`render`: no value `fst` (did you mean `fast`?); there are `exact`, `fast`",
            ),
            (json!({ "at": 3 }), "`at`: must be a list of 2 values; found integer `3`"),
        ] {
            assert_eq!(refused(given), format!("setting {told}"));
        }
    }

    #[test]
    fn names_in_files_are_told_with_the_nearest() {
        let said = "unknown field `bugdet`, expected one of `budget`, `seed`";
        assert_eq!(plain(said), "`bugdet` is unknown (did you mean `budget`?)");
        assert_eq!(
            plain("missing field `budget` at line 3 column 1"),
            "`budget` is missing at line 3 column 1"
        );
        assert_eq!(plain("something else"), "something else");
    }

    #[test]
    fn what_fits_is_read() {
        let given = json!({ "render": "fast", "at": [1.0, 2.0] });
        let Json::Object(given) = given else { panic!("settings are an object") };
        let expected = Given { render: Render::Fast, at: [1.0, 2.0], ..Given::default() };
        assert_eq!(read::<Given>(&given).unwrap(), expected);
    }
}
