//! The baselines, one folder each: settings, network, loss. [`table`] lists them.
//!
//! A new one is a folder with a settings struct and a `make` function, and one line in [`table::BASELINES`].

mod auxiliary;
pub(crate) mod bounds;
pub(crate) mod canonical;
pub(crate) mod conv_jepa;
pub(crate) mod countdown;
pub(crate) mod dino_wm;
#[cfg(test)]
mod dots;
mod encoder;
pub(crate) mod gc_idm;
pub(crate) mod gcbc;
pub(crate) mod gciql;
pub(crate) mod gcivl;
pub(crate) mod gcsl;
pub(crate) mod goal;
pub(crate) mod hilp;
pub(crate) mod joint;
pub(crate) mod keypoint_wm;
pub(crate) mod keypoints;
pub(crate) mod lewm;
pub(crate) mod pldm;
pub(crate) mod settings;
pub(crate) mod table;

pub use auxiliary::AuxiliaryWeights;
pub use canonical::{CanonicalConfig, CanonicalModelConfig};
pub use conv_jepa::{ConvJepaConfig, FeatureMapConfig, MapEncoderConfig};
pub use dino_wm::DinoWmConfig;
pub use encoder::EncoderConfig;
pub use gc_idm::{GcIdmConfig, IdmConfig, WorldConfig};
pub use gcbc::{GcbcConfig, LaterGoals};
pub use gciql::GciqlConfig;
pub use gcivl::{GcivlConfig, PolicyGoals, ValueConfig};
pub use gcsl::{CountdownConfig, CountdownWeights, GcslConfig};
pub use goal::GoalConfig;
pub use hilp::HilpConfig;
pub use joint::JointConfig;
pub use keypoint_wm::{KeypointModelConfig, KeypointWmConfig};
pub use keypoints::{KeypointEncoderConfig, KeypointsConfig};
pub use lewm::LewmConfig;
pub use pldm::{PldmConfig, PldmWeights};
