//! Datasets of other programs, read where they are. A family of layouts is one file, and one line in [`READERS`]; what is known
//! and not read is in [`known`].
//!
//! The rules that hold for all: the action of a row is the one taken from it; no rows are joined over the end of an episode; an end of a
//! recording is no termination; what a file does not hold is missing, and never made up.

mod array;
mod d4rl;
mod dataset;
mod dinowm;
mod dreamer;
mod found;
mod grouped;
mod hdf5;
mod images;
mod known;
mod lance;
mod libero;
#[cfg(feature = "lerobot")]
mod minari;
mod npz;
mod rlds;
mod torch;
mod video;
mod zarr;

use std::path::Path;

use crate::dataset::Dataset;
use crate::error::DataError;
use crate::open_options::OpenOptions;

#[cfg(feature = "lerobot")]
pub(crate) use found::REWARDS_NOTE;
pub(crate) use found::{RewardsAt, source_record};
pub(crate) use known::BRING;
pub(crate) use known::{mcap, of_hdf5, recognize};
#[cfg(feature = "lerobot")]
pub(crate) use lance::{NAMES as LEROBOT_NAMES, is_native as is_lerobot_in_lance};

/// Opens a dataset of one layout.
type Open = fn(&Path, &OpenOptions) -> Result<Box<dyn Dataset>, DataError>;

/// How datasets of one layout are recognized and opened.
pub(crate) struct Reader {
    detect: fn(&Path) -> bool,
    open: Open,
}

/// Every layout; more particular ones come first.
pub(crate) const READERS: &[Reader] = &[
    Reader { detect: dinowm::detect, open: dinowm::open },
    Reader { detect: npz::detect, open: npz::open },
    Reader { detect: dreamer::detect, open: dreamer::open },
    Reader { detect: zarr::detect, open: zarr::open },
    Reader { detect: lance::detect, open: lance::open },
    #[cfg(feature = "lerobot")]
    Reader { detect: minari::detect, open: minari::open },
    Reader { detect: rlds::detect, open: rlds::open },
    Reader { detect: grouped::detect, open: grouped::open },
    Reader { detect: d4rl::detect, open: d4rl::open },
];

/// Opens a dataset of another program; `None` if it is of no layout that is read.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Option<Result<Box<dyn Dataset>, DataError>> {
    let reader = READERS.iter().find(|reader| (reader.detect)(path))?;
    Some((reader.open)(path, options))
}

/// Whether there is a dataset of another program that is read, by its content.
pub(crate) fn detect(path: &Path) -> bool {
    READERS.iter().any(|reader| (reader.detect)(path))
}

/// A name as it is sorted by people: `demo_10` follows `demo_9`.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (word, numbers) = rest.split_at(text);
        let digits = numbers.find(|c: char| !c.is_ascii_digit()).unwrap_or(numbers.len());
        let (number, behind) = numbers.split_at(digits);
        parts.push((word.to_owned(), number.parse().unwrap_or(u64::MAX)));
        rest = behind;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::natural;

    #[test]
    fn names_with_numbers_are_sorted_by_these() {
        let mut names = ["demo_10", "demo_9", "demo_2", "demo", "a_2_x", "a_10_x", "a_2"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["a_2", "a_2_x", "a_10_x", "demo", "demo_2", "demo_9", "demo_10"]);
    }
}
