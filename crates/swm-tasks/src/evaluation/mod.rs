//! Evaluations that can be compared and repeated: manifests on disk, the success rules of the tiers, reference policies,
//! receipts, and their verification. Statistics and manifests themselves are `swm_core::evaluate`.

mod cells;
mod compare;
mod difference;
mod existing_result;
mod files;
mod gate;
mod hash;
mod image_model;
mod outdated;
mod probe;
mod probes;
mod quality;
mod receipt;
mod reference;
mod relative;
mod resume;
mod robustness;
mod run;
mod sweep;
mod tiers;
mod verify;

pub use cells::{CellLedger, Division};
pub use compare::{Compared, Side, compare};
pub use difference::{Difference, differences, result_differences};
pub use existing_result::{existing_receipt, refusal};
pub use files::{
    env_of, holds_manifest, read_manifest, read_receipt, recorded_pairs, write_manifest, write_receipt,
};
pub use gate::{GateCheck, PROBE_R2, RANK_CORRELATION};
pub use hash::{file_bytes, file_hash};
pub use image_model::ImageModel;
pub use outdated::changed_model;
pub use probe::{Fingerprints, fingerprints};
#[cfg(feature = "faer")]
pub use probes::LinearProbe;
pub use probes::{NetworkProbe, ProbeScore, ProbeTarget, Probed, Samples, probe};
pub use quality::{
    Quality, QualityOptions, Ranking, Surprised, default_probes, measurements, quality, recorded_episodes,
};
pub use receipt::{Code, RECEIPT_VERSION, Receipt};
pub use reference::{Reference, Regret, Role, roles};
pub use resume::{Ledger, identity};
pub use robustness::{Published, ROBUST_TASKS, ROBUSTNESS_VERSION, RobustTask, Robustness, RobustnessRow};
pub use run::{Candidate, ForeignPolicy, RunEpisodes, RunOptions, run_pairs};
pub(crate) use sweep::unknown_factor;
pub use sweep::{
    Cell, Change, SWEEP_VERSION, Scope, Sweep, SweepRun, Values, changes, existing_sweep, grid_points,
    is_sweep, read_sweep, write_sweep,
};
pub use tiers::{TierRules, ruled_envs, task_probes, tier_rules};
pub use verify::{Part, Verification, verify, verify_by};
pub(crate) use verify::{can_be_made, contradiction, edited};
