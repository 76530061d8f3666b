//! MCAP, the log format of robotics: opens in Foxglove, with images as `foxglove.CompressedImage` (PNG, exact) and the
//! numeric columns as JSON to plot. The records are written and read here and not by the crate `mcap`, which cannot
//! continue a file: appending and recovering need to know where every record lies.
//!
//! A channel per column of images, one channel `/step` for all other columns; a message's time is its row over all
//! episodes times the distance of two rows. Metadata records: `swm.dataset` (columns), `swm.run` (metadata of a run),
//! and behind the messages of each episode `swm.episode`, which commits it.

mod chunks;
mod describe;
mod ending;
mod foxglove;
mod index;
mod rate;
mod reader;
mod records;
mod rows;
mod summary;
mod writer;

use std::fs::File;
use std::io::Read;

use crate::entry::Format;
use crate::recording::BackendWriter;

/// The entry in the table of formats.
pub(crate) const FORMAT: Format = Format::new(
    "mcap",
    "one log file that opens in Foxglove: images and plots; exact; slow at random numbers",
    |path| {
        let mut magic = [0; records::MAGIC.len()];
        let read = File::open(path).and_then(|mut file| file.read_exact(&mut magic));
        read.is_ok() && &magic == records::MAGIC
    },
    |path| Ok(Box::new(reader::McapDataset::open(path)?)),
)
.extensions(&["mcap"])
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, writer::McapBackend)?)))
.repairer(writer::repair);
