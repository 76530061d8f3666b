//! What people do with environments, policies and datasets, below every program that they do it with.
//!
//! ```
//! use swm_core::testing::TOY;
//! use swm_core::{EnvEntry, Registry};
//! use swm_tasks::request::{Record, Request as _};
//!
//! const ENVS: &[EnvEntry] = &[TOY];
//! let folder = std::env::temp_dir().join(format!("swm-tasks-{}", std::process::id()));
//! let record = Record {
//!     env: "swm/Toy-v0".to_owned(),
//!     episodes: Some(3),
//!     image_size: None,
//!     out: folder.join("toy.h5"),
//!     ..Record::default()
//! };
//! // Notes and progress go to the report; `()` drops them.
//! let recorded = record.run(&Registry::new().with(ENVS).with(swm_data::FORMATS), &mut ())?;
//! assert_eq!(recorded.episodes, 3);
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! * [`request`]: what is asked for, as values: checked once, run once, refused with the remedy as data;
//! * [`evaluation`]: manifests on disk, receipts, sweeps, measures of world models, their verification;
//! * [`bundle`]: a result in a folder that others can verify; [`board`]: such folders as a page; [`zoo`]: trained models that are shipped;
//! * [`distractors`]: what changes the images that policies see;
//! * [`plan`], [`replay`], [`report`], [`report_page`], [`video`]: what happened, shown;
//! * [`traps`]: what versions of other software do that users do not expect;
//! * [`text_file`]: texts that a user names; [`memory`] and [`threads`] of the machine.
//!
//! This crate has no table of environments: callers hand in a [`Registry`](swm_core::Registry). It prints nothing.

pub mod board;
pub mod bundle;
pub mod distractors;
mod error;
pub mod evaluation;
mod html;
pub mod memory;
pub mod plan;
pub mod replay;
pub mod report;
pub mod report_page;
pub mod request;
mod svg;
pub mod text_file;
pub mod threads;
pub mod traps;
pub mod video;
pub mod zoo;
