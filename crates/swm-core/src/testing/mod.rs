//! Conformance checks that every environment must pass, as public functions: a downstream crate tests its own
//! environment with `assert_conforms(&ENTRY)`.

mod checks;
mod toy;

use crate::registry::EnvEntry;

pub use checks::{
    deterministic, every_factor_acts, factors_are_independent, snapshots_are_exact, spec_is_sound,
};
pub use toy::{DISCRETE_TOY, TOY};

/// Runs every check and panics with the list of all violations.
///
/// # Panics
/// If the environment violates any rule; that is what it is for.
pub fn assert_conforms(entry: &EnvEntry) {
    let checks: [(&str, Check); 5] = [
        ("spec_is_sound", spec_is_sound),
        ("deterministic", deterministic),
        ("snapshots_are_exact", snapshots_are_exact),
        ("factors_are_independent", factors_are_independent),
        ("every_factor_acts", every_factor_acts),
    ];
    let mut failures = Vec::new();
    for (name, check) in checks {
        if let Err(reason) = check(entry) {
            failures.push(format!("{name}: {reason}"));
        }
    }
    assert!(failures.is_empty(), "{} does not conform:\n  {}", entry.id, failures.join("\n  "));
}

/// One check: the reason of the first violation, or nothing.
pub type Check = fn(&EnvEntry) -> Result<(), String>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_toy_environments_conform() {
        assert_conforms(&TOY);
        assert_conforms(&DISCRETE_TOY);
    }
}
