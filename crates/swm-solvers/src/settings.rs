//! Settings as plain data: read by name, checked, listed in tables, told apart from their defaults. Where they
//! come from (a command line, a file) is not known here.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value as Json};
use swm_core::error::{did_you_mean, nearest};
use swm_core::registry::Setting;

use crate::error::PlanError;

/// A group of settings: a flat struct whose field names are the setting names.
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// Name, meaning and default of every field.
    const SETTINGS: &'static [Setting];

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

    /// The settings that differ from their defaults.
    fn changed(&self) -> Map<String, Json> {
        match (serde_json::to_value(self), serde_json::to_value(Self::default())) {
            (Ok(Json::Object(own)), Ok(Json::Object(defaults))) => {
                own.into_iter().filter(|(name, value)| defaults.get(name) != Some(value)).collect()
            }
            _ => Map::new(),
        }
    }
}

/// Takes the settings of `T` out of `given`, so that several groups can share one flat list.
pub(crate) fn take<T: Settings>(given: &mut Map<String, Json>) -> Result<T, PlanError> {
    let own: Map<String, Json> =
        T::SETTINGS.iter().filter_map(|setting| given.shift_remove_entry(setting.name)).collect();
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

/// How many settings one policy can have.
const MAX_SETTINGS: usize = 64;

/// One table made of several.
pub(crate) struct Joined {
    rows: [Setting; MAX_SETTINGS],
    length: usize,
}

impl Joined {
    /// The table.
    pub(crate) const fn as_slice(&self) -> &[Setting] {
        self.rows.split_at(self.length).0
    }
}

/// One table from several, at compile time.
pub(crate) const fn join(tables: &[&[Setting]]) -> Joined {
    let mut rows = [Setting { name: "", doc: "", default: "" }; MAX_SETTINGS];
    let (mut length, mut table) = (0, 0);
    while table < tables.len() {
        let mut row = 0;
        while row < tables[table].len() {
            rows[length] = tables[table][row];
            length += 1;
            row += 1;
        }
        table += 1;
    }
    Joined { rows, length }
}

/// Settings as they are written on the command line: `samples=100,clip=true`.
pub(crate) fn display(settings: &Map<String, Json>) -> String {
    let one = |(name, value): (&String, &Json)| match value {
        Json::String(text) => format!("{name}={text}"),
        value => format!("{name}={value}"),
    };
    settings.iter().map(one).collect::<Vec<_>>().join(",")
}
