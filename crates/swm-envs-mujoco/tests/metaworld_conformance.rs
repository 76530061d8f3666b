//! Meta-World's environments pass the public conformance suite: with images, and without, where colors, textures, lights and
//! cameras change nothing.

use swm_core::testing::{assert_conforms, assert_conforms_with};
use swm_core::{EnvConfig, EnvEntry};
use swm_envs_mujoco::metaworld;

/// What physics do not feel.
const ONLY_IN_IMAGES: &[&str] = &[
    "table.color",
    "object.color",
    "background.color",
    "table.texture",
    "floor.texture",
    "light.intensity",
    "rendering.transparent_arm",
    "agent.color",
    "camera.angle_delta",
];

fn check(entry: &EnvEntry) {
    assert_conforms(entry);
    assert_conforms_with(entry, &EnvConfig { image: None, ..EnvConfig::default() }, ONLY_IN_IMAGES);
}

macro_rules! conforms {
    ($($test:ident $entry:ident;)*) => {$(
        #[test]
        fn $test() {
            check(&metaworld::$entry);
        }
    )*};
}

conforms! {
    reach_conforms REACH;
    push_conforms PUSH;
    pick_place_conforms PICK_PLACE;
    door_open_conforms DOOR_OPEN;
    drawer_open_conforms DRAWER_OPEN;
    drawer_close_conforms DRAWER_CLOSE;
    button_press_topdown_conforms BUTTON_PRESS_TOPDOWN;
    peg_insert_side_conforms PEG_INSERT_SIDE;
    window_open_conforms WINDOW_OPEN;
    window_close_conforms WINDOW_CLOSE;
}
