//! Jobs on many machines: a request that is divided into shards, and a folder with its description and what is done.
//!
//! Schedulers start a task per shard, and report only which tasks they still hold; all else is in files.
//!
//! * [`Job`] and [`JobFolder`]: the description `job.json`, and the files of a job;
//! * [`Engine`]: a scheduler, by its [`Driver`]; [`Handover`] submits what is neither done nor queued;
//! * [`Attempt`], [`Done`], [`Failed`], [`Finished`]: what tasks write; [`Progress`] and [`Status`]: what is read from it;
//! * [`tracking`]: trackers that follow a training run.
//!
//! This crate runs no shard and prints nothing: the command `swm` does.

mod engine;
mod engines;
mod error;
mod files;
mod job;
mod log;
mod parts;
mod process;
mod program;
mod progress;
mod queue_state;
mod status;
mod submit;
pub mod task;
pub mod tracking;

pub use engine::{Driver, ENGINES, Engine, Queued, Request, Settings, Submission, engine};
pub use error::JobError;
pub use files::{is_written, node, ranges, write_json};
pub use job::{Asked, Input, Job, JobFolder, extension};
pub use log::{Attempt, attempts, last_episode, open as open_log};
pub use process::free_bytes;
pub use program::{Launcher, Package, Program, set_launcher};
pub use progress::{Done, Failed, Finished, Progress, shards_of};
pub use queue_state::QueueState;
pub use status::Status;
pub use submit::{Handover, Submitted};
pub use tracking::Tracking;
