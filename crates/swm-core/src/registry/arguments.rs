//! Arguments of a policy, as they are written on a command line.

use std::fmt;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use crate::error::PolicyError;
use crate::settings::{assignments, read, text};

/// Arguments of a policy: `name:key=value,key=value` or `name:value`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PolicyArgs {
    /// The policy's name.
    pub name: String,
    /// Values without a key, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub positional: Vec<Json>,
    /// Values with a key.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub named: Map<String, Json>,
}

impl PolicyArgs {
    /// The policy `name` with `named` settings.
    pub fn new(name: impl Into<String>, named: Map<String, Json>) -> Self {
        Self { name: name.into(), positional: Vec::new(), named }
    }

    /// Reads `name`, `name:v1,v2` or `name:key=value,…`. Values are numbers, `true`, `false`, or text.
    ///
    /// ```
    /// let args = swm_core::PolicyArgs::parse("cem:samples=100,clip=true")?;
    /// assert_eq!((args.name.as_str(), args.named.len()), ("cem", 2));
    /// # Ok::<(), swm_core::PolicyError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// A key is given twice, or settings do not follow a colon. Whether the policy knows the keys shows when it is made.
    pub fn parse(text: &str) -> Result<Self, PolicyError> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let mut args = Self { name: name.trim().to_owned(), ..Self::default() };
        if let Some((name, settings)) = args.name.split_once([' ', ',', '=']) {
            let settings = format!("{settings} {rest}").trim().replace(' ', ",");
            return Err(
                args.wrong(format!("settings follow a colon, separated by commas: `{name}:{settings}`"))
            );
        }
        for part in rest.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            match part.split_once('=') {
                Some((key, value)) => {
                    if args.named.insert(key.trim().to_owned(), literal(value.trim())).is_some() {
                        return Err(args.wrong(format!("`{}` is given twice", key.trim())));
                    }
                }
                None => args.positional.push(literal(part)),
            }
        }
        Ok(args)
    }

    /// The named arguments as the policy's own type, for policies without positional ones.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit one, with the known ones.
    pub fn parse_as<T: DeserializeOwned>(&self) -> Result<T, PolicyError> {
        if let Some(value) = self.positional.first() {
            return Err(self.wrong(format!("unexpected value `{value}`; write key=value")));
        }
        self.named_as()
    }

    /// As [`PolicyArgs::parse_as`], where the single positional value stands for `key`.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit one, with the known ones.
    pub fn parse_with<T: DeserializeOwned>(&self, key: &str) -> Result<T, PolicyError> {
        let mut args = self.clone();
        match args.positional.as_slice() {
            [] => {}
            [value] => {
                args.named.insert(key.to_owned(), value.clone());
            }
            [_, extra, ..] => return Err(self.wrong(format!("unexpected second value `{extra}`"))),
        }
        args.named_as()
    }

    fn named_as<T: DeserializeOwned>(&self) -> Result<T, PolicyError> {
        read(&self.named).map_err(|error| {
            let holds_another = |value: &Json| value.as_str().is_some_and(|text| text.contains('='));
            let separated = match self.named.get(&error.name).is_some_and(holds_another) {
                true => "; settings are separated by commas",
                false => "",
            };
            self.wrong(format!("{error}{separated}"))
        })
    }

    /// Refuses a value that is negative or not finite, as no std is.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`], with the name of the setting.
    pub fn check_not_negative(&self, name: &str, value: f64) -> Result<(), PolicyError> {
        match value >= 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(self.wrong(format!("{name} {value} must be 0 or more, and finite"))),
        }
    }

    /// An error about these arguments.
    pub fn wrong(&self, reason: impl Into<String>) -> PolicyError {
        PolicyError::Argument { policy: self.name.clone(), reason: reason.into() }
    }
}

/// As [`PolicyArgs::parse`] reads it: what `--policy` takes.
///
/// ```
/// # use swm_core::PolicyArgs;
/// for text in ["random", "constant:0.5,-1", "mpc:runs/lewm,samples=100,checkpoint=best"] {
///     assert_eq!(PolicyArgs::parse(text)?.to_string(), text);
/// }
/// # Ok::<(), swm_core::PolicyError>(())
/// ```
impl fmt::Display for PolicyArgs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all: Vec<String> = self.positional.iter().map(text).chain(assignments(&self.named)).collect();
        match all.as_slice() {
            [] => f.write_str(&self.name),
            all => write!(f, "{}:{}", self.name, all.join(",")),
        }
    }
}

/// A value as it is written on a command line.
pub(crate) fn literal(text: &str) -> Json {
    if let Ok(number) = text.parse::<i64>() {
        return number.into();
    }
    match (text, text.parse::<f64>()) {
        ("true", _) => true.into(),
        ("false", _) => false.into(),
        (_, Ok(number)) if number.is_finite() => number.into(),
        _ => text.into(),
    }
}

/// For policies without arguments.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoArgs {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_arguments_are_positional_or_named() {
        let args = PolicyArgs::parse("cem:samples=300,fast=true,name=x").unwrap();
        assert_eq!(args.named["samples"], 300);
        assert_eq!(args.named["fast"], true);
        assert_eq!(args.named["name"], "x");
        assert_eq!(
            PolicyArgs::parse("constant:0.5,-1").unwrap().positional,
            vec![0.5.into(), Json::from(-1)]
        );
        assert!(PolicyArgs::parse("cem:a=1,a=2").unwrap_err().to_string().contains("twice"));
        for (text, told) in [
            ("cem samples=20", "`cem:samples=20`"),
            ("cem,samples=20,seed=1", "`cem:samples=20,seed=1`"),
            ("cem samples=20 seed=1", "`cem:samples=20,seed=1`"),
        ] {
            let said = PolicyArgs::parse(text).unwrap_err().to_string();
            assert!(said.contains(told), "{said}");
        }
        #[derive(Debug, Deserialize)]
        struct Samples {
            #[serde(rename = "samples")]
            _samples: u32,
        }
        for (text, told) in
            [("cem:samples=20 seed=1", true), ("cem:samples=20;seed=1", true), ("cem:samples=x", false)]
        {
            let said = PolicyArgs::parse(text).unwrap().parse_as::<Samples>().unwrap_err().to_string();
            assert_eq!(said.ends_with("separated by commas"), told, "{said}");
        }
        assert!(PolicyArgs::parse("random:x=1").unwrap().parse_as::<NoArgs>().is_err());
    }
}
