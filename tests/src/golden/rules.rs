//! What is compared for which environment, how far it may be off, and where we differ on purpose.

use serde_json::{Map, Value as Json, json};

use super::classic_control as classic;
use super::fetch;
use super::own::{POINT_MAZE, PUSHT_RAPIER};
use super::piecewise::PIECEWISE;
use super::simple;

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
    CHEETAH,
    REACHER,
    ACROBOT,
    PENDULUM,
    CARTPOLE,
    BALL_IN_CUP,
    FINGER,
    HOPPER,
    WALKER,
    HUMANOID,
    MANIPULATOR,
    QUADRUPED,
    OGB_CUBE,
    OGB_SCENE,
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
];

/// What all environments of the DeepMind Control Suite have in common: bit-equal from the recorded start on.
const SUITE: Rules = Rules {
    reference_id: "",
    env_id: "",
    settings: |_| {},
    compared: &[],
    // Rewards contain exponentials, whose last bit depends on the mathematical library.
    tolerance: [Tolerance { px: 1e-12, rad: 0.0, px_per_s: 0.0 }; 2],
    images: ImageTolerance { equal_pixels: 0.0, largest_difference: 255 },
    steps: usize::MAX,
    starts: &[],
    adapt: |_| Vec::new(),
    expected_differences: &[NO_SUCCESS],
};

const NO_SUCCESS: (&str, &str) = ("info_success", "the recorded version has no success: always NaN");

/// Rules of a domain by the number of values in its positions, velocities and observation; then how its factors are adapted.
macro_rules! suite {
    ($name:ident, $id:literal, $nq:literal, $nv:literal, $observation:literal) => {
        suite!($name, $id, $nq, $nv, $observation, |_| Vec::new());
    };
    ($name:ident, $id:literal, $nq:literal, $nv:literal, $observation:literal, $adapt:expr) => {
        const $name: Rules = Rules {
            reference_id: $id,
            env_id: $id,
            compared: &[
                ("state_qpos", &[Unit::Given; $nq]),
                ("state_qvel", &[Unit::Given; $nv]),
                ("state_time", &[Unit::Given]),
                ("state_qacc_warmstart", &[Unit::Given; $nv]),
                ("obs", &[Unit::Given; $observation]),
                ("info_score", &[Unit::Reward]),
                ("reward", &[Unit::Reward]),
            ],
            adapt: $adapt,
            ..SUITE
        };
    };
}

suite!(CHEETAH, "swm/CheetahDMControl-v0", 9, 9, 17, |factors| {
    adapt_suite(factors, &["agent.back_foot_locked"], 0.4)
});
suite!(REACHER, "swm/ReacherDMControl-v0", 2, 2, 6, |factors| {
    adapt_suite(factors, &["agent.finger_locked"], 0.0)
});
suite!(ACROBOT, "swm/AcrobotDMControl-v0", 2, 2, 6, |factors| {
    let inert = ["agent.lower_arm_density", "agent.upper_arm_density", "agent.upper_arm_locked"];
    adapt_suite(factors, &inert, 0.0)
});
suite!(PENDULUM, "swm/PendulumDMControl-v0", 1, 1, 3, |factors| {
    let inert = ["agent.mass_density", "agent.mass_shape", "agent.pole_density"];
    adapt_suite(factors, &inert, 0.0)
});
suite!(CARTPOLE, "swm/CartpoleDMControl-v0", 2, 2, 5, |factors| {
    adapt_suite(factors, &["agent.cart_shape", "agent.pole_density"], 0.0)
});
suite!(FINGER, "swm/FingerDMControl-v0", 3, 3, 12);
suite!(HOPPER, "swm/HopperDMControl-v0", 7, 7, 15, |factors| {
    adapt_suite(factors, &["agent.foot_locked", "floor.friction"], 0.0)
});
suite!(WALKER, "swm/WalkerDMControl-v0", 9, 9, 24, |factors| {
    let mut differences = adapt_suite(factors, &["agent.right_knee_locked"], 0.7);
    if factors.contains_key("floor.rotation_y") {
        differences.push(
            "floor.rotation_y: the recorded floor rotates about a point 248 m ahead; trajectories differ",
        );
    }
    differences
});
suite!(HUMANOID, "swm/HumanoidDMControl-v0", 28, 27, 67, |factors| {
    adapt_suite(factors, &["agent.left_knee_locked"], 0.7)
});
suite!(MANIPULATOR, "swm/ManipulatorDMControl-v0", 11, 11, 44, |factors| {
    adapt_suite(factors, &["agent.upper_arm_length"], 0.0)
});
suite!(QUADRUPED, "swm/QuadrupedDMControl-v0", 23, 22, 78, |factors| {
    adapt_suite(factors, &["agent.knee_back_left_locked", "floor.friction"], 0.0)
});

/// OGBench's tables, replayed from the recorded start. Sums of inverse kinematics are in another order.
macro_rules! table {
    ($name:ident, $id:literal, $nq:literal, $nv:literal, $($more:tt)*) => {
        const $name: Rules = Rules {
            reference_id: $id,
            env_id: $id,
            // A recorded goal stays, whether it is reached or not.
            settings: |settings| {
                settings.insert("new_targets".to_owned(), json!(false));
            },
            compared: &[
                ("state_qpos", &[Unit::Px; $nq]),
                ("state_qvel", &[Unit::PxPerS; $nv]),
                ("state_time", &[Unit::Px]),
                ("info_control", &[Unit::Px; 7]),
                ("info_proprio.effector_pos", &[Unit::Px; 3]),
                ("info_proprio.effector_yaw", &[Unit::Rad]),
                ("info_proprio.gripper_opening", &[Unit::Px]),
                ("info_proprio.gripper_contact", &[Unit::Px]),
                ("info_privileged.block_0_pos", &[Unit::Px; 3]),
                ("info_privileged.block_0_quat", &[Unit::Px; 4]),
                $($more)*
            ],
            tolerance: [Tolerance { px: 1e-6, rad: 1e-6, px_per_s: 1e-4 }; 2],
            steps: 20,
            adapt: adapt_table,
            expected_differences: &[],
            ..SUITE
        };
    };
}

table!(OGB_CUBE, "swm/OGBCube-v0", 21, 20, ("info_privileged.target_block_pos", &[Unit::Px; 3]),);
table!(OGB_SCENE, "swm/OGBScene-v0", 25, 24, ("state_button_states", &[Unit::Given; 2]),);

/// Starts are those of the file.
fn adapt_table(factors: &mut Map<String, Json>) -> Vec<&'static str> {
    for name in ["cube.start_position", "cube.start_yaw", "cube.goal_position", "cube.goal_yaw"] {
        factors.remove(name);
    }
    Vec::new()
}

const BALL_IN_CUP: Rules = Rules {
    reference_id: "swm/BallInCupDMControl-v0",
    env_id: "swm/BallInCupDMControl-v0",
    compared: &[
        ("state_qpos", &[Unit::Given; 4]),
        ("state_qvel", &[Unit::Given; 4]),
        ("state_time", &[Unit::Given]),
        ("state_qacc_warmstart", &[Unit::Given; 4]),
        ("obs", &[Unit::Given; 8]),
    ],
    expected_differences: &[
        NO_SUCCESS,
        ("reward", "the recorded version's default target has no height: it rewards nothing"),
        ("info_score", "as the reward"),
    ],
    ..SUITE
};

/// Factors that the recorded version declares and does not apply, and floors that it makes no more slippery than the
/// agent's own geoms, `friction`, which win there.
fn adapt_suite(factors: &mut Map<String, Json>, inert: &[&str], friction: f64) -> Vec<&'static str> {
    let mut differences = Vec::new();
    for name in inert {
        if factors.remove(*name).is_some() {
            differences.push("a factor without an effect in the recorded version; replayed without it");
        }
    }
    if let Some(value) = factors.get_mut("floor.friction") {
        let recorded = value.as_array().and_then(|values| values.first()).unwrap_or(value).as_f64();
        if recorded.is_some_and(|recorded| recorded < friction) {
            *value = json!([friction]);
            differences
                .push("floor.friction: below the agent's own it has no effect in the recorded version");
        }
    }
    differences
}

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
