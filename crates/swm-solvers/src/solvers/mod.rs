//! The solvers, one file each, and their table.

mod adam;
mod adamw;
mod categorical_cem;
mod cem;
mod icem;
mod ilqr;
mod lagrangian;
mod mppi;
mod pgd;
mod predictive_sampling;
mod sgd;

use crate::solver::SolverEntry;

pub use adam::Adam;
pub use adamw::AdamW;
pub use categorical_cem::CategoricalCem;
pub use cem::Cem;
pub use icem::Icem;
pub use ilqr::Ilqr;
pub use lagrangian::{Form, Lagrangian, Optimizer};
pub use mppi::{Mppi, TemperatureMode};
pub use pgd::{Pgd, Select};
pub use predictive_sampling::PredictiveSampling;
pub use sgd::Sgd;

/// Every solver. A new one is a file in this folder and a line here; its policy on the true simulator follows.
pub const SOLVERS: &[SolverEntry] = &[
    SolverEntry::of::<Cem>(),
    SolverEntry::of::<Icem>(),
    SolverEntry::of::<Mppi>(),
    SolverEntry::of::<PredictiveSampling>(),
    SolverEntry::of::<CategoricalCem>(),
    SolverEntry::of::<Sgd>(),
    SolverEntry::of::<Adam>(),
    SolverEntry::of::<AdamW>(),
    SolverEntry::of::<Pgd>(),
    SolverEntry::of::<Lagrangian>(),
    SolverEntry::of::<Ilqr>(),
];

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
