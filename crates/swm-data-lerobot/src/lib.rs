//! The format `lerobot`: Parquet tables of numbers and H.264 videos. Versions 2.1 and 3.0 are read, 3.0 is written. Of other
//! programs' folders the only camera, or the one that is asked for, becomes `pixels`, `observation.state` becomes `proprio`, as in the
//! reference's reader, `next.reward` becomes `reward`, the text of the task a column, and `ep_idx` and `step_idx` are made up; ours also
//! hold what the columns were called, see `manifest`. Videos are read in
//! H.264 and in AV1, LeRobot's default codec, by the times of the rows (see `camera`), and images in the tables as PNG and JPEG; columns in
//! other codecs are left out by name.
//!
//! A crate of its own, for no other format needs Parquet. A registry has it beside those of `swm_data`:
//!
//! ```
//! use swm_core::Registry;
//!
//! let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_lerobot::FORMATS);
//! assert!(registry.find::<swm_data::Format>("lerobot").is_ok());
//! ```

mod camera;
mod check;
mod codecs;
mod contents;
mod episode_files;
mod episodes;
mod images;
mod info;
mod last_row;
mod manifest;
mod open_episode;
mod others;
mod parquet_file;
mod reader;
mod rows;
mod statistics;
mod table;
mod tasks;
mod values;
mod writer;

pub use table::Table;

use swm_data::adapt;
use swm_data::foreign;
use swm_data::format::{Format, StoredImages};
use swm_data::recording::BackendWriter;

/// A folder of tables and videos.
pub const LEROBOT: Format = Format::new(
    "lerobot",
    "a folder of Parquet tables and H.264 videos that LeRobot opens; lossy images",
    |path| path.join(info::INFO).is_file() && !foreign::is_lerobot_in_lance(path),
    |path| Ok(Box::new(reader::LeRobotDataset::open(path)?)),
)
.opener(|path, options| {
    let dataset = reader::LeRobotDataset::open_with(path, options)?;
    adapt::opened_with(Box::new(dataset), options, &["camera"])
})
.drops_last_row()
.extensions(&["lerobot"])
.images(StoredImages::Video)
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, writer::LeRobotBackend)?)))
.repairer(writer::repair);

/// The formats of this crate.
pub const FORMATS: &[Format] = &[LEROBOT];
