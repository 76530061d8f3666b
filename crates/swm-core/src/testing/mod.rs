//! Conformance checks that every environment must pass, as public functions: a downstream crate tests its own
//! environment with `assert_conforms(&ENTRY)`.

mod bench;
mod checks;
mod goals;
mod looks;
#[cfg(test)]
mod mutants;
mod restarts;
mod toy;

use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Map, Value as Json};

use crate::env::{EnvConfig, ImageSize};
use crate::registry::{EnvEntry, literal};
use crate::settings::Settings;

pub use checks::{
    deterministic, episode_fields_are_constant, every_factor_acts, factors_are_independent,
    snapshots_are_exact, spec_is_sound,
};
pub use goals::{NoPart, goals_look_as_recorded};
pub use looks::looks_change_images_alone;
pub use restarts::{Inexact, restarts_continue, wrong_rows_are_refused};
pub use toy::{DISCRETE_TOY, TOY};

/// What an environment does otherwise than the checks expect, each with a reason that its page gives to users.
#[derive(Clone, Copy, Debug, Default)]
pub struct Exceptions<'a> {
    /// Factors that change nothing that is checked: where no images are rendered, those of colors.
    pub without_effect: &'a [&'a str],
    /// Columns that differ after a recorded start or goal.
    pub inexact: &'a [Inexact<'a>],
    /// Columns `goal_…` in which values that are 0 in all goals are no part of a goal.
    pub no_part: &'a [NoPart<'a>],
    /// Most pixels of a recorded goal's image that differ from the recorded frame, and by how much.
    pub goal_image: [usize; 2],
}

impl<'a> Exceptions<'a> {
    /// None.
    pub const NONE: Self = Self { without_effect: &[], inexact: &[], no_part: &[], goal_image: [0; 2] };

    /// Those of `id` in a table; none if it is not listed.
    pub fn of(table: &[(&str, Self)], id: &str) -> Self {
        table.iter().find(|(known, _)| *known == id).map_or(Self::NONE, |(_, exceptions)| *exceptions)
    }
}

/// Factors without effect.
impl<'a> From<&'a [&'a str]> for Exceptions<'a> {
    fn from(without_effect: &'a [&'a str]) -> Self {
        Self { without_effect, ..Self::NONE }
    }
}

impl<'a> From<&'a Vec<&'a str>> for Exceptions<'a> {
    fn from(without_effect: &'a Vec<&'a str>) -> Self {
        Self { without_effect, ..Self::NONE }
    }
}

impl<'a, const N: usize> From<&'a [&'a str; N]> for Exceptions<'a> {
    fn from(without_effect: &'a [&'a str; N]) -> Self {
        Self { without_effect, ..Self::NONE }
    }
}

/// The size of images in [`assert_conforms`].
pub const IMAGE: ImageSize = ImageSize { height: 48, width: 64 };

/// Runs every check, with images of 48x64, and panics with the list of all violations.
///
/// # Panics
/// If the environment violates any rule; that is what it is for.
pub fn assert_conforms(entry: &EnvEntry) {
    assert_conforms_with(entry, &EnvConfig { image: Some(IMAGE), ..EnvConfig::default() }, Exceptions::NONE);
}

/// As [`assert_conforms`], for environments made with `config`, and with `exceptions`: a list of factors that must have no effect
/// (those of images, where none are rendered), or [`Exceptions`].
///
/// # Panics
/// If the environment violates any rule, or an exception is none.
pub fn assert_conforms_with<'a>(entry: &EnvEntry, config: &EnvConfig, exceptions: impl Into<Exceptions<'a>>) {
    let failures = violations(entry, config, exceptions.into());
    assert!(failures.is_empty(), "{} does not conform:\n  {}", entry.id, failures.join("\n  "));
}

/// What [`assert_conforms_with`] panics with: one line a check that fails, which begins with its name. Where the description is not
/// sound, nothing else is checked.
pub fn violations(entry: &EnvEntry, config: &EnvConfig, exceptions: Exceptions<'_>) -> Vec<String> {
    let Exceptions { without_effect, inexact, no_part, goal_image } = exceptions;
    // The others rely on it.
    if let Err(reason) = spec_is_sound(entry, config) {
        return vec![format!("spec_is_sound: {reason}")];
    }
    let results = [
        ("deterministic", deterministic(entry, config)),
        ("episode_fields_are_constant", episode_fields_are_constant(entry, config)),
        ("snapshots_are_exact", snapshots_are_exact(entry, config)),
        ("factors_are_independent", factors_are_independent(entry, config)),
        ("every_factor_acts", every_factor_acts(entry, config, without_effect)),
        ("looks_change_images_alone", looks_change_images_alone(entry, config)),
        ("restarts_continue", restarts_continue(entry, config, inexact, no_part)),
        ("goals_look_as_recorded", goals_look_as_recorded(entry, config, goal_image)),
        ("wrong_rows_are_refused", wrong_rows_are_refused(entry, config)),
    ];
    results.into_iter().filter_map(|(name, result)| Some(format!("{name}: {}", result.err()?))).collect()
}

/// [`assert_conforms`] for a table of environments, on all cores, with the exceptions of those that have any.
///
/// # Panics
/// If any environment violates a rule, or an exception is none, or is of an environment that is not in the table.
pub fn assert_all_conform<'e>(
    entries: impl IntoIterator<Item = &'e EnvEntry>,
    exceptions: &[(&str, Exceptions<'_>)],
) {
    let config = EnvConfig { image: Some(IMAGE), ..EnvConfig::default() };
    let entries: Vec<&EnvEntry> = entries.into_iter().collect();
    let next = AtomicUsize::new(0);
    let check = || {
        let mut failures = Vec::new();
        while let Some(entry) = entries.get(next.fetch_add(1, Ordering::Relaxed)) {
            let found = violations(entry, &config, Exceptions::of(exceptions, entry.id));
            failures.extend(found.into_iter().map(|violation| format!("{}: {violation}", entry.id)));
        }
        failures
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut failures = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(check)).collect();
        let panicked = |_| vec!["a check panicked: see above".to_owned()];
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_else(panicked)).collect::<Vec<_>>()
    });
    let unknown = exceptions.iter().filter(|(id, _)| !entries.iter().any(|entry| entry.id == *id));
    failures.extend(unknown.map(|(id, _)| format!("{id}: has exceptions, and is not in the table")));
    failures.sort();
    assert!(failures.is_empty(), "these do not conform:\n  {}", failures.join("\n  "));
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
    }

    #[test]
    fn who_judges_success_says_what_it_is() {
        let silent = EnvEntry::new(TOY.id, TOY.summary, |config| TOY.make(config));
        let reason = spec_is_sound(&silent, &EnvConfig::default()).unwrap_err();
        assert!(reason.contains(".success("), "{reason}");
    }
}
