//! Rules of in-house environments, which have no reference: recorded by `record_golden` with all factors set, and equal to
//! the bit.

use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

const OWN: Rules = Rules {
    reference_id: "",
    env_id: "",
    settings: |_| {},
    compared: &[],
    tolerance: [Tolerance { px: 0.0, rad: 0.0, px_per_s: 0.0 }; 2],
    images: ImageTolerance { equal_pixels: 0.9999, largest_difference: 0 },
    steps: usize::MAX,
    starts: &[],
    adapt: |_| Vec::new(),
    expected_differences: &[],
};

pub(super) const PUSHT_RAPIER: Rules = Rules {
    reference_id: "swm/PushTRapier-v0",
    env_id: "swm/PushTRapier-v0",
    compared: &[
        ("obs_state", &[Unit::Given; 7]),
        ("reward", &[Unit::Given]),
        ("goal_state", &[Unit::Given; 7]),
    ],
    ..OWN
};

pub(super) const POINT_MAZE: Rules = Rules {
    reference_id: "swm/PointMaze-v0",
    env_id: "swm/PointMaze-v0",
    compared: &[
        ("obs_state", &[Unit::Given; 4]),
        ("reward", &[Unit::Given]),
        ("goal_state", &[Unit::Given; 4]),
    ],
    ..OWN
};
