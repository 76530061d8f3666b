//! The workspace from outside: the command `swm` as a user runs it, on real files.
//!
//! One binary, one module per promise.

mod at_once;
mod bad_input;
#[cfg(unix)]
mod book;
mod bundles;
mod chosen;
mod commands;
mod completions;
mod crash;
mod damaged_recordings;
mod datasets;
mod determinism;
mod docs;
mod engines;
mod evaluation;
mod experts;
mod factor_bounds;
mod hostile_json;
mod hyperqueue;
mod images;
mod interop;
mod jobs;
mod looks;
mod merging;
mod newcomer;
mod no_locks;
mod other_programs;
mod planning;
mod preload;
mod python_defaults;
mod quality;
mod replayable;
mod reports;
#[cfg(feature = "ui")]
mod requests;
mod results;
mod shards;
mod shell;
mod slurm;
mod streams;
mod support;
#[cfg(feature = "ui")]
mod ui;
