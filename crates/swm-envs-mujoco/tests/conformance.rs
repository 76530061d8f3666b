//! Every environment of the table passes the public conformance suite, images included; `fetch_conformance.rs` has Fetch.

use swm_core::testing::{assert_conforms, assert_conforms_with};
use swm_core::{EnvConfig, ImageSize};
use swm_envs_mujoco::{ENVS, FINGER};

/// These change how Finger's spinner turns, and nothing turns it here: see the test of the spinner in `suite.rs`.
const ONLY_IN_MOTION: &[&str] = &["spinner.density", "spinner.friction"];

#[test]
fn all_environments_conform() {
    let is_elsewhere = |id: &str| id == FINGER.id || id.starts_with("swm/Fetch");
    for entry in ENVS.iter().filter(|entry| !is_elsewhere(entry.id)) {
        assert_conforms(entry);
    }
}

#[test]
fn finger_conforms_but_for_a_spinner_at_rest() {
    let config = EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() };
    assert_conforms_with(&FINGER, &config, ONLY_IN_MOTION);
}
