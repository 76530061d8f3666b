//! Datasets: formats, readers, writers, and the windowed loader.
//!
//! * [`mod@format`]: the table of formats; [`open`] and [`create`] choose by content and by extension;
//! * [`dataset`]: what an open dataset offers (random rows and strided windows of single columns), write modes;
//! * [`loader`]: clips of `num_steps` rows at a `frameskip`, batched into a reused table, shuffled by (seed, epoch).
//!
//! Recording goes through the core: a [`DatasetWriter`] is an `EpisodeSink`, which `World::record_dataset` fills.
//! This crate knows no environment and no solver.
//!
//! ```no_run
//! use std::path::Path;
//! use swm_data::loader::{ClipOptions, Loader};
//!
//! # fn main() -> Result<(), swm_data::DataError> {
//! let dataset = swm_data::open(Path::new("pusht.h5"))?;
//! let mut loader = Loader::new(dataset, &ClipOptions { num_steps: 4, frameskip: 5, ..Default::default() })?;
//! let mut batch = loader.new_batch();
//! let mut epoch = loader.epoch(64, Some((42, 0)));
//! while epoch.next_into(&mut batch)? {
//!     // batch.get::<u8>("pixels"): [64, 4, H, W, 3]; batch.get::<f32>("action"): [64, 4, 5 × A]
//! }
//! # Ok(())
//! # }
//! ```

pub mod dataset;
pub mod error;
pub mod format;
mod formats;
pub mod loader;
mod lock;

pub use dataset::{Dataset, DatasetWriter, Steps, WriteMode};
pub use error::DataError;
pub use format::{FORMATS, Format, create, open};
pub use loader::{ClipOptions, Loader};
