//! Datasets: formats, readers, writers, and the windowed loader.
//!
//! ```no_run
//! use std::path::Path;
//! use swm_data::loader::{BatchOptions, ClipOptions, Loader};
//!
//! # fn main() -> Result<(), swm_data::DataError> {
//! let dataset = swm_data::open(Path::new("pusht.h5"))?;
//! let loader = Loader::new(dataset, &ClipOptions::default().num_steps(4).frameskip(5))?;
//! let mut batches = loader.batches(&BatchOptions::default().size(64).shuffle(Some(42)))?;
//! let mut batch = batches.new_batch();
//! for _epoch in 0..10 {
//!     while batches.next_batch(&mut batch)? {
//!         // batch.get::<u8>("pixels"): [64, 4, H, W, 3]; batch.get::<f32>("action"): [64, 4, 5 × A]
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! * [`mod@format`]: the table of formats; [`open`] and [`create`] choose by content and by extension, [`open_in`] and
//!   [`create_in`] among the formats of a registry;
//! * [`dataset`]: what an open dataset offers (random rows and strided windows of single columns), write modes;
//! * [`adapt`]: datasets made of datasets: subsets and splits, concatenation, columns merged, joined or cached;
//! * [`episodes`]: which rows of a table are an episode, for formats of other crates;
//! * [`foreign`]: what readers of datasets of other programs share; the readers are in the crate `swm-data-foreign`;
//! * [`element`], [`hdf5`], [`npz`], [`codecs`]: what files hold, for readers of other crates;
//! * [`recording`]: what all formats do alike when they record, for formats of other crates;
//! * [`memory`]: episodes in memory as a dataset; [`buffer`]: the replay buffer of online learning;
//! * [`rendered`]: recordings without images, whose images are drawn when they are read;
//! * [`stats`]: means, standard deviations, extremes and quantiles of columns, kept beside the dataset;
//! * [`tools`]: copying between formats, verifying, comparing;
//! * [`testing`]: what a format must stand, for formats of other crates;
//! * [`loader`]: clips of `num_steps` rows at a `frameskip`, with sampled goals, read ahead into reused tables.
//!
//! Recording goes through the core: a [`DatasetWriter`] is an `EpisodeSink`, which `World::record_dataset` fills.
//! Files below all of this are those of the crate `swm-files`, also behind `https://`, `s3://` and `hf://`. This crate knows no environment and
//! no solver.

#[macro_use]
mod setters;

pub mod adapt;
pub mod buffer;
pub mod codecs;
pub mod dataset;
pub mod element;
#[cfg(feature = "remote")]
mod elsewhere;
mod entry;
pub mod episodes;
pub mod error;
pub mod foreign;
pub mod format;
mod formats;
mod guarded;
pub mod hdf5;
pub mod loader;
pub mod memory;
pub mod npz;
mod open_options;
pub mod recording;
pub mod rendered;
pub mod stats;
pub mod testing;
pub mod tools;
#[cfg(feature = "video")]
pub mod video;

pub use buffer::{ReplayBuffer, Sampler};
pub use dataset::{Dataset, DatasetInfo, DatasetWriter, LastRow, Steps, WriteMode, WriteOptions};
pub use error::DataError;
pub use format::{FORMATS, Format, Layout, create, create_in, create_with, open, open_in, open_with};
pub use loader::{BatchOptions, CacheOptions, ClipOptions, Loader};
pub use memory::MemoryDataset;
pub use open_options::{Channels, Flip, OpenOptions};
pub use rendered::{Looks, RenderOptions, Rendered};
