//! Dataset formats on Lance tables, in the layout of the reference, which reads our tables and whose tables are read
//! here: `lance`, with images as JPEG in the rows, and `lance-video`, with a video per episode in a table beside it.
//!
//! A crate of its own, for the crates of Lance take many minutes to build. It stands on those that read and write files
//! and manifests; Lance's query engine is deliberately absent. Its formats stand in a registry
//! beside those of `swm_data`:
//!
//! ```
//! use swm_core::Registry;
//!
//! let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_lance::FORMATS);
//! assert!(registry.find::<swm_data::Format>("lance").is_ok());
//! ```

mod arrays;
mod committed;
mod data_file;
mod manifest;
mod reader;
mod table;
mod videos;
mod writer;

use swm_data::format::{Format, StoredImages};
use swm_data::recording::BackendWriter;

use crate::reader::LanceDataset;
use crate::table::Table;
use crate::writer::{IMAGES, LanceBackend, VIDEOS};

/// Images in the rows.
pub const LANCE: Format = Format::new(
    IMAGES,
    "a folder of columns, the reference's own format; lossy images (JPEG)",
    |path| Table::exists(path) && !Table::exists(&videos::folder(path)),
    |path| Ok(Box::new(LanceDataset::open(path, IMAGES)?)),
)
.extensions(&["lance"])
.images(StoredImages::Lossy)
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, LanceBackend { has_videos: false })?)))
.repairer(|path, apply| writer::repair(path, IMAGES, apply));

/// A video per episode in a table beside the rows, `name_videos.lance`.
pub const LANCE_VIDEO: Format = Format::new(
    VIDEOS,
    "two folders of columns, with videos for images; small, lossy images (H.264)",
    |path| Table::exists(path) && Table::exists(&videos::folder(path)),
    |path| Ok(Box::new(LanceDataset::open(path, VIDEOS)?)),
)
.extensions(&["lance-video"])
.images(StoredImages::Video)
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, LanceBackend { has_videos: true })?)))
.repairer(|path, apply| writer::repair(path, VIDEOS, apply));

/// The formats of this crate.
pub const FORMATS: &[Format] = &[LANCE, LANCE_VIDEO];
