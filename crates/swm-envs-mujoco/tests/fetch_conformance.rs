//! Fetch passes the public conformance suite: each task with images, and its other forms without.

use swm_core::testing::{assert_conforms, assert_conforms_with};
use swm_core::{EnvConfig, EnvEntry};
use swm_envs_mujoco::{
    FETCH_PICK_AND_PLACE, FETCH_PICK_AND_PLACE_DENSE, FETCH_PICK_AND_PLACE_DICT, FETCH_PUSH,
    FETCH_PUSH_DENSE, FETCH_PUSH_DICT, FETCH_REACH, FETCH_REACH_DENSE, FETCH_REACH_DICT, FETCH_SLIDE,
    FETCH_SLIDE_DENSE, FETCH_SLIDE_DICT,
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

fn check(with_images: &EnvEntry, others: [&EnvEntry; 2]) {
    assert_conforms(with_images);
    for entry in others {
        assert_conforms_with(entry, &EnvConfig { image: None, ..EnvConfig::default() }, ONLY_IN_IMAGES);
    }
}

#[test]
fn reach_conforms() {
    check(&FETCH_REACH, [&FETCH_REACH_DENSE, &FETCH_REACH_DICT]);
}

#[test]
fn push_conforms() {
    check(&FETCH_PUSH, [&FETCH_PUSH_DENSE, &FETCH_PUSH_DICT]);
}

#[test]
fn slide_conforms() {
    check(&FETCH_SLIDE, [&FETCH_SLIDE_DENSE, &FETCH_SLIDE_DICT]);
}

#[test]
fn pick_and_place_conforms() {
    check(&FETCH_PICK_AND_PLACE, [&FETCH_PICK_AND_PLACE_DENSE, &FETCH_PICK_AND_PLACE_DICT]);
}
