//! What is compared for which environment, how far it may be off, and where we differ on purpose.

use serde_json::{Map, Value as Json, json};

use super::classic_control as classic;
use super::fetch;
use super::mazes;
use super::own::{POINT_MAZE, PUSHT_RAPIER};
use super::piecewise::PIECEWISE;
use super::simple;
use super::suite;

/// The rules of one environment of the reference.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// The reference's id.
    pub reference_id: &'static str,
    /// Ours.
    pub env_id: &'static str,
    /// Settings that make ours behave like the recorded version.
    pub settings: fn(&mut Map<String, Json>),
    /// The compared arrays by their key in the file, with the unit of every element.
    pub compared: &'static [(&'static str, &'static [Unit])],
    /// What is accepted at default factors, and what with any factor set.
    pub tolerance: [Tolerance; 2],
    /// How far images may be off.
    pub images: ImageTolerance,
    /// How many steps are compared: contacts make everything after some number chaotic.
    pub steps: usize,
    /// Step columns that hold the start, with the factor that each sets: `(array, first entry, factor)`.
    pub starts: &'static [(&'static str, usize, &'static str)],
    /// Adapts the factors of a file to those that were in force when it was recorded; returns what differs on
    /// purpose, in words.
    pub adapt: fn(&mut Map<String, Json>) -> Vec<&'static str>,
    /// Arrays in which we differ on purpose, with the reason.
    pub expected_differences: &'static [(&'static str, &'static str)],
}

impl Rules {
    /// Whether the recorded images are drawn and compared.
    pub fn compares_images(&self) -> bool {
        self.images.equal_pixels > 0.0
    }
}

/// Accepted differences of images.
#[derive(Clone, Copy, Debug)]
pub struct ImageTolerance {
    /// Share of pixels that must be equal; 0: images are not compared.
    pub equal_pixels: f64,
    /// Largest accepted difference of the others, in levels of 255.
    pub largest_difference: u8,
}

/// The unit of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Pixels.
    Px,
    /// Radians; compared modulo a full turn.
    Rad,
    /// Pixels per second.
    PxPerS,
    /// Something that must agree to the bit.
    Given,
    /// Reward: mixed units.
    Reward,
    /// A share, 0 to 1.
    Share,
}

/// Accepted absolute differences.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Of lengths, in pixels; rewards likewise.
    pub px: f64,
    /// Of angles.
    pub rad: f64,
    /// Of velocities.
    pub px_per_s: f64,
}

impl Tolerance {
    /// The accepted difference of a number.
    pub fn of(&self, unit: Unit) -> f64 {
        match unit {
            Unit::Px | Unit::Reward | Unit::Share => self.px,
            Unit::Rad => self.rad,
            Unit::PxPerS => self.px_per_s,
            Unit::Given => 0.0,
        }
    }
}

/// The rules for an id of the reference; `None` if the environment does not exist here.
pub fn rules(reference_id: &str) -> Option<&'static Rules> {
    RULES.iter().find(|rules| rules.reference_id == reference_id)
}

const RULES: &[Rules] = &[
    PUSHT,
    TWO_ROOM,
    TWO_ROOM_V2,
    suite::CHEETAH,
    suite::REACHER,
    suite::ACROBOT,
    suite::PENDULUM,
    suite::CARTPOLE,
    suite::BALL_IN_CUP,
    suite::FINGER,
    suite::HOPPER,
    suite::WALKER,
    suite::HUMANOID,
    suite::MANIPULATOR,
    suite::QUADRUPED,
    suite::OGB_CUBE,
    suite::OGB_SCENE,
    PUSHT_RAPIER,
    POINT_MAZE,
    classic::CART_POLE,
    classic::MOUNTAIN_CAR,
    classic::MOUNTAIN_CAR_CONTINUOUS,
    classic::ACROBOT,
    classic::PENDULUM,
    fetch::REACH,
    fetch::PUSH,
    fetch::SLIDE,
    fetch::PICK_AND_PLACE,
    PIECEWISE,
    simple::POINT_MAZE,
    simple::NAVIGATION,
    mazes::HUMANOID,
    mazes::ANT_SOCCER,
];

const PUSHT: Rules = Rules {
    reference_id: "swm/PushT-v1",
    env_id: "swm/PushT-v1",
    settings: |_| {},
    compared: &[
        ("obs_state", &[Unit::Px, Unit::Px, Unit::Px, Unit::Px, Unit::Rad, Unit::PxPerS, Unit::PxPerS]),
        ("obs_proprio", &[Unit::Px, Unit::Px, Unit::PxPerS, Unit::PxPerS]),
        ("info_block_pose", &[Unit::Px, Unit::Px, Unit::Rad]),
        ("reward", &[Unit::Reward]),
        ("goal_state", &[Unit::Given; 7]),
        ("goal_pose", &[Unit::Given; 3]),
    ],
    tolerance: [
        Tolerance { px: 1e-6, rad: 1e-8, px_per_s: 1e-5 },
        Tolerance { px: 0.5, rad: 0.01, px_per_s: 5.0 },
    ],
    images: ImageTolerance { equal_pixels: 0.995, largest_difference: 255 },
    steps: usize::MAX,
    starts: &[
        ("obs_state", 0, "agent.start_position"),
        ("obs_state", 2, "block.start_position"),
        ("info_block_pose", 2, "block.angle"),
    ],
    adapt: adapt_pusht,
    expected_differences: &[
        ("info_n_contacts", "the recorded version divides by 1000 instead of 10 (operator precedence)"),
        ("terminated", "the recorded version accepts wrong angles: it does not wrap their difference"),
    ],
};

const TWO_ROOM: Rules = Rules {
    reference_id: "swm/TwoRoom-v1",
    env_id: "swm/TwoRoom-v1",
    settings: |_| {},
    compared: &[
        ("obs_state", &[Unit::Px, Unit::Px, Unit::Given, Unit::Given, Unit::Given, Unit::Given]),
        ("obs_proprio", &[Unit::Px; 2]),
        ("info_n_contacts", &[Unit::Given]),
        ("info_energy", &[Unit::Given]),
        ("info_fraction_of_goal", &[Unit::Share]),
        ("info_fraction_of_agent", &[Unit::Share]),
        ("reward", &[Unit::Reward]),
        ("goal_pos", &[Unit::Given; 2]),
    ],
    tolerance: [Tolerance { px: 1e-9, rad: 0.0, px_per_s: 0.0 }; 2],
    // Not one pixel may differ.
    images: ImageTolerance { equal_pixels: 1.0 - 1e-9, largest_difference: 0 },
    steps: usize::MAX,
    starts: &[("obs_state", 0, "agent.position"), ("obs_state", 2, "goal.position")],
    adapt: |_| Vec::new(),
    expected_differences: &[],
};

/// The recorded version (January 2026): the T ignores `block.scale` and has scale 30, other shapes default to 40;
/// the drawn goal ignores `goal.scale`; the Z is built off-center.
fn adapt_pusht(factors: &mut Map<String, Json>) -> Vec<&'static str> {
    let mut differences = Vec::new();
    let shape = factors.get("block.shape").and_then(Json::as_i64).unwrap_or(2);
    if shape == 2 {
        if factors.remove("block.scale").is_some() {
            differences.push("block.scale: the recorded T ignores it; replayed at the scale 30 that it used");
        }
    } else {
        factors.entry("block.scale").or_insert(json!(40.0));
    }
    if factors.remove("goal.scale").is_some() {
        differences.push("goal.scale: the recorded version ignores it; replayed without");
    }
    if shape == 3 || factors.get("agent.shape").and_then(Json::as_i64) == Some(3) {
        differences.push("shape Z: the recorded version builds it off-center; trajectories differ");
    }
    differences
}

const TWO_ROOM_V2: Rules = Rules {
    // The reference registers it as `swm/TwoRoom-v1`, like the paper's version; the files say which one they mean.
    reference_id: "swm/TwoRoom-v2",
    env_id: "swm/TwoRoom-v2",
    settings: |_| {},
    compared: &[
        ("obs_state", &[Unit::Given; 2]),
        ("obs_observation", &[Unit::Given; 10]),
        ("info_distance_to_target", &[Unit::Given]),
        ("goal_state", &[Unit::Given; 2]),
        ("reward", &[Unit::Given]),
        ("terminated", &[Unit::Given]),
    ],
    tolerance: [Tolerance { px: 0.0, rad: 0.0, px_per_s: 0.0 }; 2],
    // One byte in 10,000 is asked for; a frame has 50,176 pixels.
    images: ImageTolerance { equal_pixels: 0.9999, largest_difference: 1 },
    steps: usize::MAX,
    starts: &[("obs_state", 0, "agent.position")],
    adapt: |factors| match factors.remove("wall.border_color") {
        Some(_) => vec!["wall.border_color: the recorded version ignores it; replayed without"],
        None => Vec::new(),
    },
    expected_differences: &[],
};
