//! Dataset formats on Lance tables, in the layout of the reference, which reads our tables and whose tables are read
//! here: `lance`, with images as JPEG in the rows, and `lance-video`, with a video per episode in a table beside it.
//!
//! A crate of its own, for the crates of Lance take many minutes to build. It stands on those that read and write files
//! and manifests; Lance's query engine is deliberately absent. Its formats are known to `swm_data` once they are
//! registered:
//!
//! ```
//! swm_data_lance::register()?;
//! assert!(swm_data::format::by_name("lance").is_ok());
//! # Ok::<(), swm_data::DataError>(())
//! ```

mod arrays;
mod committed;
mod data_file;
mod manifest;
mod reader;
mod table;
mod videos;
mod writer;

use std::path::Path;

use swm_data::recording::BackendWriter;
use swm_data::{DataError, Format};

use crate::reader::LanceDataset;
use crate::table::Table;
use crate::writer::LanceBackend;

/// Images in the rows.
pub const LANCE: Format = Format {
    name: "lance",
    extensions: &["lance"],
    about: "a folder of columns, the reference's own format; lossy images (JPEG)",
    detect: |path| Table::exists(path) && !Table::exists(&videos::folder(path)),
    open: |path| Ok(Box::new(LanceDataset::open(path, LANCE.name)?)),
    create: |path, options| Ok(Box::new(BackendWriter::new(path, options, LanceBackend::images())?)),
    repair: |path, apply| writer::repair(path, LANCE.name, apply),
};

/// A video per episode in a table beside the rows, `name_videos.lance`.
pub const LANCE_VIDEO: Format = Format {
    name: "lance-video",
    extensions: &["lance-video"],
    about: "two folders of columns, with videos for images; small, lossy images (H.264)",
    detect: |path| Table::exists(path) && Table::exists(&videos::folder(path)),
    open: |path| Ok(Box::new(LanceDataset::open(path, LANCE_VIDEO.name)?)),
    create: |path, options| Ok(Box::new(BackendWriter::new(path, options, LanceBackend::videos())?)),
    repair: |path, apply| writer::repair(path, LANCE_VIDEO.name, apply),
};

/// The formats of this crate.
pub static FORMATS: [Format; 2] = [LANCE, LANCE_VIDEO];

/// Makes the formats of this crate known to `swm_data`; more than once is as good as once.
///
/// # Errors
///
/// Another crate has registered a format of the same name.
pub fn register() -> Result<(), DataError> {
    FORMATS.iter().try_for_each(swm_data::format::register)
}

/// What a table is called: its folder without `.lance`.
fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
