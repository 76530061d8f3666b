//! Conformance checks that every environment must pass, as public functions: a downstream crate tests its own
//! environment with `assert_conforms(&ENTRY)`.

mod checks;
mod toy;

use crate::env::{EnvConfig, ImageSize};
use crate::registry::EnvEntry;

pub use checks::{
    deterministic, every_factor_acts, factors_are_independent, snapshots_are_exact, spec_is_sound,
};
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_toy_environments_conform() {
        assert_conforms(&TOY);
        assert_conforms(&DISCRETE_TOY);
    }
}
