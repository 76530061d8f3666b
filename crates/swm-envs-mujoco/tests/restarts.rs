//! Episodes that start at recorded steps continue as the recorded ones did, and images of recorded goals are the recorded frames;
//! what is lost is listed here, with the reason, and told by the environment's page.

use swm_core::testing::{Inexact, goals_look_as_recorded, restarts_continue};
use swm_core::{EnvConfig, ImageSize};
use swm_envs_mujoco::ENVS;

fn config() -> EnvConfig {
    EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() }
}

/// It sums rewards / 1000 since the reset, of at most 1 each.
const SCORE: &[Inexact<'_>] =
    &[Inexact { column: "score", first: 0.05, later: 0.05, reason: "it sums the rewards since the reset" }];

/// What differs, by environment.
const INEXACT: &[(&str, &[Inexact<'_>])] = &[
    ("swm/HumanoidDMControl-v0", SCORE),
    ("swm/CheetahDMControl-v0", SCORE),
    ("swm/WalkerDMControl-v0", SCORE),
    ("swm/ManipulatorDMControl-v0", SCORE),
    ("swm/QuadrupedDMControl-v0", SCORE),
    ("swm/HopperDMControl-v0", SCORE),
    ("swm/PendulumDMControl-v0", SCORE),
];

/// Pixels of a goal that differ from the recorded frame, and by how much, by environment and reason.
const OTHER_GOALS: &[(&str, [usize; 2], &str)] = &[
    ("swm/OGBCube-v0", [80, 160], "frames show the state 2 ms earlier"),
    ("swm/FetchReach-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchReachDense-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchReachDict-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPush-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPushDense-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPushDict-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchSlide-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchSlideDense-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchSlideDict-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPickAndPlace-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPickAndPlaceDense-v3", MOCAP, MOCAP_REASON),
    ("swm/FetchPickAndPlaceDict-v3", MOCAP, MOCAP_REASON),
];

const MOCAP: [usize; 2] = [80, 160];
const MOCAP_REASON: &str = "the body that pulls the gripper is no part of a goal";

#[test]
fn restarts_of_all_environments_continue_as_recorded() {
    let of = |id: &str| INEXACT.iter().find(|(env, _)| *env == id).map_or(&[][..], |(_, columns)| columns);
    let failures = ENVS.iter().filter_map(|entry| restarts_continue(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn goals_of_all_environments_look_as_recorded() {
    let of = |id: &str| OTHER_GOALS.iter().find(|(env, ..)| *env == id).map_or([0, 0], |(_, most, _)| *most);
    let failures =
        ENVS.iter().filter_map(|entry| goals_look_as_recorded(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
