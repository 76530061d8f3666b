//! Work on many machines: a job is one command that is divided into shards, in a folder that says what is asked for and what is
//! done. Schedulers start a task per shard and are asked only which tasks they still hold.

pub(crate) mod engine;
mod engines;
mod error;
pub(crate) mod files;
pub(crate) mod held;
pub(crate) mod job;
pub(crate) mod log;
mod process;
mod program;
pub(crate) mod progress;

pub(crate) use engine::engine;
pub(crate) use error::JobError;
pub(crate) use job::{Job, JobFolder};
pub(crate) use process::free_bytes;
pub(crate) use program::Program;
pub use program::{Launcher, set_launcher};
