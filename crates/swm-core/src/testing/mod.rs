//! Conformance checks that every environment must pass, as public functions: a downstream crate tests its own
//! environment with `assert_conforms(&ENTRY)`.

mod checks;
mod restarts;
mod toy;

use serde_json::{Map, Value as Json};

use crate::env::{EnvConfig, ImageSize};
use crate::registry::{EnvEntry, literal};
use crate::settings::Settings;

pub use checks::{
    deterministic, every_factor_acts, factors_are_independent, snapshots_are_exact, spec_is_sound,
};
pub use restarts::{Inexact, goals_look_as_recorded, restarts_continue};
pub use toy::{DISCRETE_TOY, TOY};

/// Runs every check, with small images, and panics with the list of all violations.
///
/// # Panics
/// If the environment violates any rule; that is what it is for.
pub fn assert_conforms(entry: &EnvEntry) {
    let config = EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() };
    assert_conforms_with(entry, &config, &[]);
}

/// As [`assert_conforms`], for environments made with `config`. Where it asks for no images, the factors of
/// `only_in_images` must change nothing, and all others something.
///
/// # Panics
/// If the environment violates any rule.
pub fn assert_conforms_with(entry: &EnvEntry, config: &EnvConfig, only_in_images: &[&str]) {
    let results = [
        ("spec_is_sound", spec_is_sound(entry, config)),
        ("deterministic", deterministic(entry, config)),
        ("snapshots_are_exact", snapshots_are_exact(entry, config)),
        ("factors_are_independent", factors_are_independent(entry, config)),
        ("every_factor_acts", every_factor_acts(entry, config, only_in_images)),
    ];
    let failures =
        results.into_iter().filter_map(|(name, result)| Some(format!("{name}: {}", result.err()?)));
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{} does not conform:\n  {}", entry.id, failures.join("\n  "));
}

/// Checks that every default of a table of settings, read as on a command line, is the default. Where nothing is set (`null`,
/// `[]` or `{}`), the table may say so in words.
///
/// # Panics
/// If a documented default is not the default.
pub fn assert_documented_defaults<T: Settings>() {
    let json = |settings: &T| serde_json::to_value(settings).unwrap_or_default();
    let defaults = json(&T::default());
    let names: Vec<&String> = defaults.as_object().into_iter().flat_map(Map::keys).collect();
    assert_eq!(names, T::SETTINGS.iter().map(|setting| setting.name).collect::<Vec<_>>(), "one per field");
    for setting in T::SETTINGS {
        let is_nothing = match &defaults[setting.name] {
            Json::Array(list) => list.is_empty(),
            Json::Object(map) => map.is_empty(),
            value => value.is_null(),
        };
        let given = Json::Object(Map::from_iter([(setting.name.to_owned(), literal(setting.default))]));
        let read = serde_json::from_value(given).map(|settings| json(&settings));
        let is_default = read.is_ok_and(|read| read == defaults);
        assert!(is_nothing || is_default, "`{}` is not the default of `{}`", setting.default, setting.name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_toy_environments_conform() {
        assert_conforms(&TOY);
        assert_conforms(&DISCRETE_TOY);
        for entry in [&TOY, &DISCRETE_TOY] {
            assert_eq!(restarts_continue(entry, &EnvConfig::default(), &[]), Ok(()));
        }
    }

    #[test]
    fn who_judges_success_says_what_it_is() {
        let silent = EnvEntry::new(TOY.id, TOY.summary, |config| TOY.make(config));
        let reason = spec_is_sound(&silent, &EnvConfig::default()).unwrap_err();
        assert!(reason.contains(".success("), "{reason}");
    }
}
