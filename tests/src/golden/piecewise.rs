//! Piecewise: states equal to the bit from the recorded start on. The recording ran on NumPy in the place of torch, so that
//! pixels may be one level off, as may the last bit of distances.

use serde_json::{Map, Value as Json};

use super::file::GoldenFile;
use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

pub(super) const PIECEWISE: Rules = Rules {
    reference_id: "swm/Piecewise",
    env_id: "swm/Piecewise-v0",
    settings: |_| {},
    compared: &[
        ("obs", &[Unit::Given; 4]),
        ("info_distance_to_target", &[Unit::Px]),
        ("terminated", &[Unit::Given]),
    ],
    tolerance: [Tolerance { px: 2e-5, rad: 0.0, px_per_s: 0.0 }; 2],
    images: ImageTolerance { equal_pixels: 0.98, largest_difference: 1 },
    steps: usize::MAX,
    starts: &[],
    adapt: |_| Vec::new(),
    expected_differences: &[],
};

/// The grid of a run, which its number of zones tells.
pub(super) fn set_grid(file: &GoldenFile, settings: &mut Map<String, Json>) {
    let zones = file.factors.keys().filter(|name| name.starts_with("zones.bias_")).count();
    if file.env_id == PIECEWISE.reference_id && zones == 9 {
        settings.insert("grid_n".to_owned(), 3.into());
    }
}
