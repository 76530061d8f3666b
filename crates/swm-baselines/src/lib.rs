//! Baselines: world models and goal-conditioned policies that train on a dataset's clips, and then plan or act.
//!
//! ```no_run
//! use swm_baselines::Device;
//! use swm_baselines::acting::ModelCost;
//! use swm_baselines::train::{TrainedModel, Which};
//! use swm_solvers::{Cem, MpcPolicy, PlanConfig};
//!
//! let run = std::path::Path::new("runs/lewm"); // of a training
//! let cost = ModelCost::new(TrainedModel::open(run, Which::default(), Device::default())?)?;
//! let (scale, action_block) = (cost.action_scale(), cost.action_block());
//! let config = PlanConfig { action_block, ..PlanConfig::default() };
//! // A policy for a world; `Mpc` plans without one.
//! let policy = MpcPolicy::new(Box::new(Cem::default()), Box::new(cost), config)?.with_scale(scale);
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! Each model is a folder of `models/` and one line in [`BASELINES`]. [`make`] gives one with fresh weights, [`restore`]
//! one of a stored [`ModelConfig`]; both are a [`Baseline`]: it takes training steps, saves and loads weights (safetensors,
//! and the files of PyTorch), and gives itself as a [`PlanModel`] or a [`GoalPolicy`]. Everything at this boundary is
//! slices of values; no tensor leaves the crate. [`train`] makes runs of it: epochs, checkpoints, metrics. [`acting`] puts trained
//! models behind the traits of solvers and policies. [`online`] trains agents in environments. [`trainer`] runs the requests of
//! trainings. No environment is known here.
//!
//! Values are those of the reference's PyTorch modules (`src/parity`), and results do not depend on threads or on what else
//! is in a batch.

pub mod acting;
mod baseline;
#[cfg(test)]
mod contract;
mod data;
mod device;
mod dynamics;
mod error;
mod images;
mod learner;
mod models;
mod network;
pub mod online;
#[cfg(test)]
mod parity;
mod plan;
mod precision;
mod reading;
#[cfg(feature = "testing")]
pub mod testing;
pub mod train;
pub mod trainer;
pub mod weights;

pub use baseline::{
    Baseline, Canonicalizer, GoalPolicy, InputSpec, LatentPolicy, Losses, ModelConfig, Phase, PhaseGoals,
    PlanModel, Step,
};
pub use data::{ClipBatch, DataDims, Images, Normalization, Observations, PlanningBatch, Vectors};
pub use device::Device;
pub use error::BaselineError;
pub use models::table::{BASELINES, BaselineEntry, MakeOptions, make, restore};
pub use models::{
    AuxiliaryWeights, CanonicalConfig, CanonicalModelConfig, ConvJepaConfig, CountdownConfig,
    CountdownWeights, DinoWmConfig, EncoderConfig, FeatureMapConfig, GcIdmConfig, GcbcConfig, GciqlConfig,
    GcivlConfig, GcslConfig, GoalConfig, HilpConfig, IdmConfig, JointConfig, KeypointEncoderConfig,
    KeypointModelConfig, KeypointWmConfig, KeypointsConfig, LaterGoals, LewmConfig, MapEncoderConfig,
    PldmConfig, PldmWeights, PolicyGoals, ValueConfig, WorldConfig,
};
pub use precision::Precision;
pub use swm_nn::losses::SigregConfig;
pub use swm_nn::optim::{OptimConfig, Schedule};
pub use swm_nn::{
    CnnConfig, FilmPredictorConfig, GoalTransformerConfig, KeypointConfig, Pool, PredictorConfig, VitConfig,
};
