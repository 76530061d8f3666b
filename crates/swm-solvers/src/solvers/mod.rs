//! The solvers, one file each, and their table.

mod cem;

use crate::solver::SolverEntry;

pub use cem::Cem;

/// Every solver. A new one is a file in this folder and a line here; its policy on the true simulator follows.
pub const SOLVERS: &[SolverEntry] = &[SolverEntry::of::<Cem>()];

#[cfg(test)]
mod tests {
    use serde_json::Map;

    use super::*;

    #[test]
    fn every_solver_is_made_from_its_documented_defaults() {
        for entry in SOLVERS {
            assert!(!entry.summary.is_empty() && !entry.settings.is_empty());
            let solver = (entry.make)(Map::new()).unwrap();
            assert_eq!(solver.name(), entry.name);
            assert!(solver.changed_settings().is_empty());
        }
    }
}
