//! SimplePointMaze and SimpleNavigation: states equal to the bit from the recorded start on. The files name the environments
//! without their versions.

use serde_json::{Map, Value as Json};

use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

const SIMPLE: Rules = Rules {
    reference_id: "",
    env_id: "",
    settings: |_| {},
    compared: &[],
    tolerance: [Tolerance { px: 0.0, rad: 0.0, px_per_s: 0.0 }; 2],
    images: ImageTolerance { equal_pixels: 0.0, largest_difference: 0 },
    steps: usize::MAX,
    starts: &[],
    adapt: |_| Vec::new(),
    expected_differences: &[],
};

pub(super) const POINT_MAZE: Rules = Rules {
    reference_id: "swm/SimplePointMaze",
    env_id: "swm/SimplePointMaze-v0",
    compared: &[
        ("state_state", &[Unit::Given; 2]),
        ("reward", &[Unit::Given]),
        ("terminated", &[Unit::Given]),
    ],
    // Matplotlib flattens circles in its own way: their edges may be 2 levels off.
    images: ImageTolerance { equal_pixels: 0.99, largest_difference: 2 },
    adapt: forget_moved_agent,
    expected_differences: &[(
        "goal_png",
        "the recorded version shows the agent at a random place; here it is at the goal",
    )],
    ..SIMPLE
};

pub(super) const NAVIGATION: Rules = Rules {
    reference_id: "swm/SimpleNavigation",
    env_id: "swm/SimpleNavigation-v0",
    compared: &[
        ("state_state", &[Unit::Given; 5]),
        ("goal_state", &[Unit::Given; 5]),
        ("reward", &[Unit::Given]),
        ("terminated", &[Unit::Given]),
    ],
    // Not one pixel may differ.
    images: ImageTolerance { equal_pixels: 1.0 - 1e-9, largest_difference: 0 },
    ..SIMPLE
};

/// The recorded factor follows the agent; it starts where the first row says.
fn forget_moved_agent(factors: &mut Map<String, Json>) -> Vec<&'static str> {
    factors.remove("agent.position");
    Vec::new()
}

/// Whether the recorded `state` of an environment is the column of that name here.
pub(super) fn records_state(env: &str) -> bool {
    [POINT_MAZE, NAVIGATION].iter().any(|rules| rules.reference_id.strip_prefix("swm/") == Some(env))
}
