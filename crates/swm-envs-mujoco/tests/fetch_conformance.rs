//! The forms of Fetch without images pass the public conformance suite; `conformance.rs` has all with images.

use swm_core::testing::assert_conforms_with;
use swm_core::{EnvConfig, EnvEntry};
use swm_envs_mujoco::{
    FETCH_PICK_AND_PLACE_DENSE, FETCH_PICK_AND_PLACE_DICT, FETCH_PUSH_DENSE, FETCH_PUSH_DICT,
    FETCH_REACH_DENSE, FETCH_REACH_DICT, FETCH_SLIDE_DENSE, FETCH_SLIDE_DICT,
};

/// What physics do not feel.
const ONLY_IN_IMAGES: &[&str] = &[
    "table.color",
    "object.color",
    "background.color",
    "light.intensity",
    "camera.angle_delta",
    "rendering.transparent_arm",
];

fn check(entries: [&EnvEntry; 2]) {
    for entry in entries {
        assert_conforms_with(entry, &EnvConfig { image: None, ..EnvConfig::default() }, ONLY_IN_IMAGES);
    }
}

#[test]
fn reach_conforms() {
    check([&FETCH_REACH_DENSE, &FETCH_REACH_DICT]);
}

#[test]
fn push_conforms() {
    check([&FETCH_PUSH_DENSE, &FETCH_PUSH_DICT]);
}

#[test]
fn slide_conforms() {
    check([&FETCH_SLIDE_DENSE, &FETCH_SLIDE_DICT]);
}

#[test]
fn pick_and_place_conforms() {
    check([&FETCH_PICK_AND_PLACE_DENSE, &FETCH_PICK_AND_PLACE_DICT]);
}
