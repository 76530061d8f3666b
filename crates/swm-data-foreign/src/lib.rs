//! Datasets of other programs, read where they are: a family of layouts is one file, and one line in [`LAYOUTS`]. What is known and not
//! read is in `swm_data`.
//!
//! ```
//! use swm_core::Registry;
//!
//! let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_foreign::LAYOUTS);
//! let error = swm_data::open_in(&registry, "none.zarr".as_ref()).err();
//! assert!(error.is_some_and(|error| error.to_string().contains("none.zarr")));
//! ```
//!
//! The rules that hold for all: the action of a row is the one taken from it; no rows are joined over the end of an episode; an end of a
//! recording is no termination; what a file does not hold is missing, and never made up.

mod aloha;
mod array;
mod d4rl;
mod dataset;
mod dinowm;
mod dreamer;
mod encoded;
mod found;
mod grouped;
mod groups;
mod hdf5;
mod hdf5_files;
mod images;
mod lance;
mod libero;
#[cfg(feature = "lerobot")]
mod minari;
mod npz;
mod rlds;
mod torch;
mod vd4rl;
mod video;
mod zarr;

use swm_data::Layout;

/// Every layout; more particular ones come first.
pub const LAYOUTS: &[Layout] = &[
    Layout::new("dino-wm", "DINO-WM: tensors of PyTorch", dinowm::detect, dinowm::open),
    Layout::new("npz", "OGBench, PLDM: archives of NumPy arrays", npz::detect, npz::open),
    Layout::new(
        "dreamer",
        "DreamerV2, DreamerV3, V-D4RL: an archive for each episode",
        dreamer::detect,
        dreamer::open,
    ),
    Layout::new("zarr", "diffusion_policy, UMI: replay buffers in Zarr", zarr::detect, zarr::open),
    Layout::new("lance-table", "stable-worldmodel, LeRobot: tables of Lance", lance::detect, lance::open),
    #[cfg(feature = "lerobot")]
    Layout::new(
        "minari-parquet",
        "Minari: a table of Parquet for each episode",
        minari::detect,
        minari::open,
    ),
    Layout::new("rlds", "RLDS, Open X-Embodiment: records of TensorFlow Datasets", rlds::detect, rlds::open),
    Layout::new(
        "hdf5-groups",
        "robomimic, LIBERO, MimicGen, Minari, ManiSkill: a group of HDF5 for each episode",
        grouped::detect,
        grouped::open,
    ),
    Layout::new("d4rl", "D4RL: episodes end to end in an HDF5 file", d4rl::detect, d4rl::open),
    Layout::new("vd4rl", "V-D4RL: episodes end to end in HDF5 files", vd4rl::detect, vd4rl::open),
    Layout::new("aloha", "ALOHA, ACT: an HDF5 file for each episode", aloha::detect, aloha::open),
];

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
