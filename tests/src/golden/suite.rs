//! Environments on MuJoCo that are replayed from the recorded state: the DeepMind Control Suite and OGBench's tables.

use serde_json::{Map, Value as Json, json};

use super::rules::{ImageTolerance, Rules, Tolerance, Unit};

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
        pub(super) const $name: Rules = Rules {
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
        pub(super) const $name: Rules = Rules {
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

pub(super) const BALL_IN_CUP: Rules = Rules {
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
