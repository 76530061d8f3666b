//! The data model and the one loop of stable-worldmodel.
//!
//! ```
//! use swm_core::testing::TOY;
//! use swm_core::{Rollout, World, WorldOptions, policies};
//!
//! let mut world = World::new(&TOY, WorldOptions::new(4))?; // a small environment, for tests
//! world.set_policy(policies::random())?;
//! let evaluation = world.evaluate(&Rollout::new(0..10).seed(42))?; // in parallel; the same episodes on any number of threads
//! assert_eq!(evaluation.episodes, 10);
//! # Ok::<(), swm_core::WorldError>(())
//! ```
//!
//! * [`batch`]: typed columns and tables, the one shape that all data has;
//! * [`space`], [`seed`]: what values may be, and where randomness comes from;
//! * [`env`](mod@env), [`policy`]: the two traits that a user implements;
//! * [`policies`]: those that fit every environment;
//! * [`run`]: which episodes run, and how;
//! * [`Observations`]: rows that come from elsewhere than a world;
//! * [`world`]: many environments in parallel, one `infos` table, one rollout loop;
//! * [`recorder`], [`dataset`], [`evaluate`]: what watches the loop;
//! * [`moments`]: means and stds, and when numbers count as constant;
//! * [`view`]: how images are shown: distractors;
//! * [`registry`]: tables of environments, policies, and whatever else has a name;
//! * [`settings`](mod@settings): settings with their defaults and help, declared once;
//! * [`testing`]: conformance checks that any environment can run.
//!
//! This crate knows no file format, no image format, no physics and no tensor.

pub mod batch;
pub mod checkpoint;
pub mod dataset;
pub mod env;
pub mod error;
pub mod evaluate;
pub mod moments;
mod observations;
pub mod policies;
pub mod policy;
pub mod recorder;
pub mod registry;
pub mod run;
pub mod seed;
pub mod settings;
pub mod space;
pub mod success;
pub mod testing;
mod threads;
pub mod view;
pub mod world;

pub use batch::{Batch, Column, Dtype, Field, FieldKind, Row, RowsMut, Schema, Slice, SliceMut, Value};
pub use dataset::{DataError, Dataset, DatasetInfo, EpisodeSink, Metadata, RecordingPart, Steps};
pub use env::{
    Env, EnvConfig, EnvSpec, EnvState, Episode, FactorSpec, ImageSize, Keypoint, Outcome, ResetOptions,
};
pub use error::{BatchError, BoxError, EnvError, PolicyError, UnknownName, WorldError};
pub use evaluate::{EvalOptions, Evaluation, Manifest};
pub use observations::Observations;
pub use policy::{Actions, Actor, PerEpisode, Policy, SlotView, View};
pub use recorder::{LiveStep, Recorder};
pub use registry::{Entry, EnvEntry, EnvTask, PolicyArgs, PolicyContext, PolicyEntry, Registry, Setting};
pub use run::{Cancel, EpisodeEnd, LiveEpisode, MAX_FRAME_SKIP, Margins, Rollout, RunInfo, WorldOptions};
pub use seed::EpisodeSeed;
pub use settings::Settings;
pub use space::Space;
pub use success::SuccessRule;
pub use world::{Run, SavedSlot, World};
