//! The solvers, one file each, and their table.

mod adam;
mod adamw;
mod categorical_cem;
mod cem;
#[cfg(feature = "faer")]
mod cma_es;
#[cfg(feature = "faer")]
mod full_cem;
mod grasp;
mod icem;
#[cfg(feature = "faer")]
mod ilqr;
mod lagrangian;
mod mppi;
mod pgd;
mod predictive_sampling;
mod sgd;

use crate::entry::SolverEntry;

pub use adam::Adam;
pub use adamw::AdamW;
pub use categorical_cem::CategoricalCem;
pub use cem::Cem;
#[cfg(feature = "faer")]
pub use cma_es::CmaEs;
#[cfg(feature = "faer")]
pub use full_cem::FullCem;
pub use grasp::{Grasp, Sync};
pub use icem::Icem;
#[cfg(feature = "faer")]
pub use ilqr::Ilqr;
pub use lagrangian::{Lagrangian, Optimizer, Penalty};
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
    #[cfg(feature = "faer")]
    SolverEntry::of::<FullCem>(),
    #[cfg(feature = "faer")]
    SolverEntry::of::<CmaEs>(),
    SolverEntry::of::<Sgd>(),
    SolverEntry::of::<Adam>(),
    SolverEntry::of::<AdamW>(),
    SolverEntry::of::<Grasp>(),
    SolverEntry::of::<Pgd>(),
    SolverEntry::of::<Lagrangian>(),
    #[cfg(feature = "faer")]
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
            let solver = entry.make(Map::new()).unwrap();
            assert_eq!(solver.name(), entry.name);
            assert!(solver.changed_settings().is_empty());
        }
    }
}
