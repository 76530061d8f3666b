//! OGBench's tables in other settings pass the public conformance suite; `conformance.rs` has the default ones.

use serde_json::json;
use swm_core::testing::{Exceptions, assert_conforms_with};
use swm_core::{EnvConfig, ImageSize};
use swm_envs_mujoco::OGB_CUBE;

#[test]
fn two_cubes_and_tasks_conform() {
    for settings in [json!({"env_type": "double"}), json!({"mode": "task"})] {
        let settings = settings.as_object().cloned().expect("settings");
        let config = EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), settings };
        // Frames show the state 2 ms earlier.
        let exceptions = Exceptions { goal_image: [80, 160], ..Exceptions::NONE };
        assert_conforms_with(&OGB_CUBE, &config, exceptions);
    }
}
