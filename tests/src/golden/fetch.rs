//! Fetch: positions and velocities equal to the bit from the recorded start on. The files name the environments without their
//! versions.

use serde_json::{Map, Value as Json};

use super::file::GoldenFile;
use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

const FETCH: Rules = Rules {
    reference_id: "",
    env_id: "",
    settings: |_| {},
    compared: &[],
    // Products of Jacobians and velocities are summed in another order.
    tolerance: [Tolerance { px: 1e-9, rad: 0.0, px_per_s: 0.0 }; 2],
    // Drawn by MuJoCo's renderer there.
    images: ImageTolerance { equal_pixels: 0.0, largest_difference: 255 },
    steps: usize::MAX,
    starts: &[],
    adapt,
    expected_differences: &[],
};

/// Starts and goals come from the recorded rows, so that only the mass matters; colors and cameras have no part in states.
fn adapt(factors: &mut Map<String, Json>) -> Vec<&'static str> {
    factors.retain(|name, _| name == "block.mass");
    Vec::new()
}

/// Why a run cannot be replayed: its environment was not drawn, and PickAndPlace computes positions anew in drawing.
pub(super) fn was_not_drawn(file: &GoldenFile) -> Option<&'static str> {
    let is_undrawn = file.env_id == PICK_AND_PLACE.reference_id && !file.name.contains(" world_");
    is_undrawn.then_some(
        "recorded without drawing, which computes positions anew after every step; here that is always done: trajectories \
         differ",
    )
}

/// Rules by the number of values in positions, velocities and observation.
macro_rules! fetch {
    ($name:ident, $recorded:literal, $id:literal, $nq:literal, $nv:literal, $observation:literal, $flat:literal) => {
        pub(super) const $name: Rules = Rules {
            reference_id: $recorded,
            env_id: $id,
            compared: &[
                ("state_qpos", &[Unit::Given; $nq]),
                ("state_qvel", &[Unit::Given; $nv]),
                ("state_time", &[Unit::Given]),
                ("state_qacc_warmstart", &[Unit::Given; $nv]),
                ("state_mocap_pos", &[Unit::Given; 3]),
                ("state_mocap_quat", &[Unit::Given; 4]),
                ("info_proprio", &[Unit::Reward; $observation]),
                ("achieved_goal", &[Unit::Given; 3]),
                ("goal_state", &[Unit::Given; 3]),
                ("obs", &[Unit::Reward; $flat]),
                ("reward", &[Unit::Given]),
                ("is_success", &[Unit::Given]),
            ],
            ..FETCH
        };
    };
}

fetch!(REACH, "swm/FetchReach", "swm/FetchReach-v3", 15, 15, 10, 13);
fetch!(PUSH, "swm/FetchPush", "swm/FetchPush-v3", 22, 21, 25, 28);
fetch!(SLIDE, "swm/FetchSlide", "swm/FetchSlide-v3", 22, 21, 25, 28);
fetch!(PICK_AND_PLACE, "swm/FetchPickAndPlace", "swm/FetchPickAndPlace-v3", 22, 21, 25, 28);
