//! LeRobot datasets, versions 2.1 and 3.0, read only: Parquet tables of numbers and H.264 films. The first camera becomes
//! `pixels`, `observation.state` becomes `proprio`, as in the reference's reader; `ep_idx` and `step_idx` are made up.
//! Films in AV1, which is LeRobot's default codec, cannot be decoded here: their columns are left out by name.

mod info;
mod reader;
mod table;

use crate::error::DataError;
use crate::format::Format;

/// The entry in the table of formats.
pub(crate) const FORMAT: Format = Format {
    name: "lerobot",
    extensions: &["lerobot"],
    about: "a folder of LeRobot 2.1 or 3.0, read only: Parquet tables and H.264 films",
    detect: |path| path.join(info::INFO).is_file(),
    open: |path| Ok(Box::new(reader::LeRobotDataset::open(path)?)),
    create: |path, _| {
        Err(DataError::record(path, "the format `lerobot` is only read; use hdf5, folder, video or mcap"))
    },
    repair: |_, _| Ok(Vec::new()),
};
