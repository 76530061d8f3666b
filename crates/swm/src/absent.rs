//! Names that only builds with a feature know, so that they are not taken for typing errors.

use swm_core::evaluate::ModelEntry;
use swm_core::registry::Absent;
use swm_core::{EnvEntry, PolicyEntry};
use swm_tasks::request::TrainerEntry;

/// A macro that is `,FEATURE` where this build has the feature, and else nothing.
macro_rules! held {
    ($name:ident, $feature:literal) => {
        #[cfg(feature = $feature)]
        macro_rules! $name {
            () => {
                concat!(",", $feature)
            };
        }
        #[cfg(not(feature = $feature))]
        macro_rules! $name {
            () => {
                ""
            };
        }
    };
}

held!(baselines, "baselines");
held!(lance, "lance");
held!(lerobot, "lerobot");
held!(onnx, "onnx");

/// How to build with a feature, and with those of this build that are not there by default.
macro_rules! build_with {
    ($feature:literal) => {
        concat!(
            "in a checkout, cargo install --locked --path crates/swm --features ",
            $feature,
            baselines!(),
            lance!(),
            lerobot!(),
            onnx!(),
            "; in a crate of your own, add `",
            $feature,
            "` to the features of `swm` in Cargo.toml"
        )
    };
}

/// A feature that a build may lack.
pub(crate) struct Feature {
    pub(crate) is_built: bool,
    /// `feature onnx`.
    pub(crate) title: &'static str,
    /// What it brings.
    pub(crate) brings: &'static str,
    /// How to build with it.
    pub(crate) command: &'static str,
}

macro_rules! feature {
    ($name:literal, $brings:literal) => {
        Feature {
            is_built: cfg!(feature = $name),
            title: concat!("feature ", $name),
            brings: $brings,
            command: build_with!($name),
        }
    };
}

/// The features that bring commands, environments, policies or formats.
pub(crate) const FEATURES: &[Feature] = &[
    feature!("baselines", "`swm train`, and policies and models that it trained"),
    feature!("lance", "writing Lance tables, and reading their videos and checksums"),
    feature!("lerobot", "LeRobot datasets"),
    feature!("mp4", "videos in MP4; needs a C++ compiler"),
    feature!("mujoco", "environments on MuJoCo"),
    feature!("onnx", "world models exported to ONNX: `--policy onnx:DIR`"),
    feature!("rapier", "environments on rapier"),
    feature!("remote", "datasets behind https://, s3:// and hf://"),
    feature!("ui", "the local page of `swm ui`"),
];

/// A feature, and how to build with it.
pub(crate) const BASELINES: (&str, &str) = (
    "baselines",
    concat!(build_with!("baselines"), "; or use the command `swm-rs` of the Python package, which has it"),
);
const LANCE: (&str, &str) = ("lance", build_with!("lance"));
const LEROBOT: (&str, &str) = (
    "lerobot",
    concat!(build_with!("lerobot"), "; or use the command `swm-rs` of the Python package, which has it"),
);
const MP4: (&str, &str) = ("mp4", build_with!("mp4"));
const MUJOCO: (&str, &str) = ("mujoco", build_with!("mujoco"));
const ONNX: (&str, &str) = (
    "onnx",
    concat!(build_with!("onnx"), "; or use the command `swm-rs` of the Python package, which has it"),
);
#[cfg(all(feature = "cli", not(feature = "remote")))]
pub(crate) const REMOTE: (&str, &str) = ("remote", build_with!("remote"));
const RAPIER: (&str, &str) = ("rapier", build_with!("rapier"));

const fn policy(name: &'static str, (feature, command): (&'static str, &'static str)) -> Absent {
    Absent::of::<PolicyEntry>(name, feature, command)
}

const fn format(name: &'static str, (feature, command): (&'static str, &'static str)) -> Absent {
    Absent::of::<swm_data::Format>(name, feature, command)
}

const fn layout(name: &'static str, (feature, command): (&'static str, &'static str)) -> Absent {
    Absent::of::<swm_data::Layout>(name, feature, command)
}

const fn model(name: &'static str) -> Absent {
    Absent::of::<ModelEntry>(name, BASELINES.0, BASELINES.1)
}

const fn env(id: &'static str, (feature, command): (&'static str, &'static str)) -> Absent {
    Absent::of::<EnvEntry>(id, feature, command)
}

/// What trains anything.
const TRAINING: Absent = Absent::of::<TrainerEntry>(TrainerEntry::TRAINING, BASELINES.0, BASELINES.1);

/// All of them; those that this build has are found first.
pub(crate) const NAMES: &[Absent] = &[
    policy("mpc", BASELINES),
    policy("policy", BASELINES),
    policy("lewm", BASELINES),
    policy("pldm", BASELINES),
    policy("dino-wm", BASELINES),
    policy("gc-idm", BASELINES),
    policy("gcbc", BASELINES),
    policy("gcivl", BASELINES),
    policy("gcsl", BASELINES),
    policy("gciql", BASELINES),
    policy("hilp", BASELINES),
    policy("sac", BASELINES),
    policy("tdmpc2", BASELINES),
    policy("zoo", BASELINES),
    policy("onnx", ONNX),
    model("conv-jepa"),
    model("lewm"),
    model("pldm"),
    model("dino-wm"),
    model("keypoint-wm"),
    TRAINING,
    format("lance", LANCE),
    format("lance-video", LANCE),
    format("lerobot", LEROBOT),
    format("video", MP4),
    layout("minari-parquet", LEROBOT),
    env("swm/PushTRapier-v0", RAPIER),
    env("swm/PointMaze-v0", RAPIER),
    env("swm/PFRocketLanding-v0", RAPIER),
    env("swm/TablePush3D-v0", RAPIER),
    env("swm/HumanoidDMControl-v0", MUJOCO),
    env("swm/CheetahDMControl-v0", MUJOCO),
    env("swm/HopperDMControl-v0", MUJOCO),
    env("swm/ReacherDMControl-v0", MUJOCO),
    env("swm/WalkerDMControl-v0", MUJOCO),
    env("swm/AcrobotDMControl-v0", MUJOCO),
    env("swm/PendulumDMControl-v0", MUJOCO),
    env("swm/CartpoleDMControl-v0", MUJOCO),
    env("swm/BallInCupDMControl-v0", MUJOCO),
    env("swm/FingerDMControl-v0", MUJOCO),
    env("swm/ManipulatorDMControl-v0", MUJOCO),
    env("swm/QuadrupedDMControl-v0", MUJOCO),
    env("swm/OGBCube-v0", MUJOCO),
    env("swm/OGBScene-v0", MUJOCO),
    env("swm/OGBPointMaze-v0", MUJOCO),
    env("swm/OGBAntMaze-v0", MUJOCO),
    env("swm/OGBHumanoidMaze-v0", MUJOCO),
    env("swm/OGBAntSoccer-v0", MUJOCO),
    env("swm/FetchReach-v3", MUJOCO),
    env("swm/FetchReachDense-v3", MUJOCO),
    env("swm/FetchReachDict-v3", MUJOCO),
    env("swm/FetchPush-v3", MUJOCO),
    env("swm/FetchPushDense-v3", MUJOCO),
    env("swm/FetchPushDict-v3", MUJOCO),
    env("swm/FetchSlide-v3", MUJOCO),
    env("swm/FetchSlideDense-v3", MUJOCO),
    env("swm/FetchSlideDict-v3", MUJOCO),
    env("swm/FetchPickAndPlace-v3", MUJOCO),
    env("swm/FetchPickAndPlaceDense-v3", MUJOCO),
    env("swm/FetchPickAndPlaceDict-v3", MUJOCO),
    env("swm/MetaWorldReach-v0", MUJOCO),
    env("swm/MetaWorldPush-v0", MUJOCO),
    env("swm/MetaWorldPickPlace-v0", MUJOCO),
    env("swm/MetaWorldDoorOpen-v0", MUJOCO),
    env("swm/MetaWorldDrawerOpen-v0", MUJOCO),
    env("swm/MetaWorldDrawerClose-v0", MUJOCO),
    env("swm/MetaWorldButtonPressTopdown-v0", MUJOCO),
    env("swm/MetaWorldPegInsertSide-v0", MUJOCO),
    env("swm/MetaWorldWindowOpen-v0", MUJOCO),
    env("swm/MetaWorldWindowClose-v0", MUJOCO),
];

#[cfg(test)]
mod tests {
    use swm_core::Entry as _;

    use super::*;

    /// Whoever adds an environment to a crate that a feature brings adds it to the table.
    #[cfg(any(feature = "rapier", feature = "mujoco"))]
    #[test]
    fn every_environment_of_a_feature_is_named() {
        let mut optional: Vec<&str> = Vec::new();
        #[cfg(feature = "mujoco")]
        optional.extend(swm_envs_mujoco::ENVS.iter().map(|entry| entry.id));
        #[cfg(feature = "rapier")]
        optional.extend(["swm/PushTRapier-v0", "swm/PointMaze-v0"]);
        #[cfg(feature = "rapier")]
        optional.extend(swm_envs_3d::ENVS.iter().map(|entry| entry.id));
        for id in optional {
            assert!(NAMES.iter().any(|absent| absent.name() == id), "{id} is not in the table");
            assert!(crate::registry().env(id).is_ok(), "{id}");
        }
    }

    #[test]
    fn a_missing_format_names_its_feature() {
        let registry = crate::registry();
        for (name, feature) in [("lance", "lance"), ("lerobot", "lerobot"), ("video", "mp4")] {
            if let Err(error) = swm_data::format::by_name(&registry, name) {
                let message = error.to_string();
                let add =
                    format!("in a crate of your own, add `{feature}` to the features of `swm` in Cargo.toml");
                assert!(message.contains(&add), "{message}");
            }
        }
    }

    #[test]
    fn a_missing_feature_is_no_typing_error() {
        let registry = crate::registry();
        let entry = registry.env("swm/PushT-v1").unwrap();
        for (name, feature) in [("onnx", "onnx"), ("mpc", "baselines"), ("gcbc", "baselines")] {
            match registry.policy_entry(entry, name) {
                Ok(_) => {}
                Err(error) => {
                    let message = error.to_string();
                    let command = format!("cargo install --locked --path crates/swm --features {feature}");
                    assert!(message.contains(&command) && !message.contains("did you mean"), "{message}");
                }
            }
        }
    }
}
