//! Datasets of other programs: NumPy archives, Zarr, HDF5 with groups, folders of DINO-WM.

use std::fs;
use std::path::Path;

use swm_data::testing::mutations;

use crate::registry;
use crate::sample::{Sample, Samples};

/// The fixtures of the tests.
pub fn samples() -> Samples {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/field");
    let entries = fs::read_dir(golden).expect("the fixtures are there");
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("it is listed").path()).collect();
    paths.sort();
    let is_dataset = |path: &&std::path::PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        // Those of LeRobot have a target.
        !["json", "py"].contains(&ending)
            && !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("lerobot"))
    };
    Samples::new(paths.iter().filter(is_dataset).map(|path| Sample::copy(path)).collect())
}

/// Reads everything.
pub fn read(path: &Path) {
    mutations::play_in(&registry(), path);
}
