//! The data model and the one loop of stable-worldmodel.
//!
//! * [`batch`]: typed columns and tables, the one shape that all data has;
//! * [`space`], [`seed`]: what values may be, and where randomness comes from;
//! * [`env`](mod@env), [`policy`]: the two traits that a user implements;
//! * [`smooth`]: random actions that change little from step to step;
//! * [`world`]: many environments in parallel, one `infos` table, one rollout loop;
//! * [`recorder`], [`dataset`], [`evaluate`]: what watches the loop;
//! * [`view`]: how images are shown: distractors;
//! * [`registry`]: tables of environments, policies, and whatever else has a name;
//! * [`testing`]: conformance checks that any environment can run.
//!
//! This crate knows no file format, no image format, no physics and no tensor.

pub mod batch;
pub mod dataset;
pub mod env;
pub mod error;
pub mod evaluate;
mod pace;
pub mod policy;
pub mod recorder;
pub mod registry;
pub mod seed;
pub mod smooth;
pub mod space;
pub mod testing;
pub mod view;
pub mod world;

pub use batch::{Batch, Column, Dtype, Field, FieldKind, Row, RowsMut, Schema, Slice, SliceMut, Value};
pub use dataset::{Contents, EpisodeSink, EpisodeSource, Metadata};
pub use env::{
    Env, EnvConfig, EnvSpec, EnvState, Episode, FactorSpec, ImageSize, Outcome, Place, ResetOptions,
};
pub use error::{BatchError, BoxError, EnvError, PolicyError, UnknownName, WorldError};
pub use evaluate::{EvalOptions, Evaluation, Manifest, SuccessRule};
pub use policy::{Actions, Actor, LiveEpisode, PerEpisode, Policy, RowView, View};
pub use recorder::{EpisodeEnd, LiveRow, Margins, Recorder, RunInfo};
pub use registry::{Entry, EnvEntry, PolicyArgs, PolicyContext, PolicyEntry, Registry, Setting};
pub use seed::EpisodeSeed;
pub use space::Space;
pub use world::{MAX_FRAME_SKIP, Rollout, Scenario, World, WorldOptions};
