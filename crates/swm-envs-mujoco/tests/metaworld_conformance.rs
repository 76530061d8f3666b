//! Meta-World's environments pass the public conformance suite without images, where colors, textures, lights and cameras change
//! nothing; `conformance.rs` has them with images.

use swm_core::EnvConfig;
use swm_core::testing::assert_conforms_with;
use swm_envs_mujoco::ENVS;

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

#[test]
fn all_ten_conform() {
    std::thread::scope(|scope| {
        for entry in ENVS.iter().filter(|entry| entry.id.starts_with("swm/MetaWorld")) {
            scope.spawn(|| {
                assert_conforms_with(
                    entry,
                    &EnvConfig { image: None, ..EnvConfig::default() },
                    ONLY_IN_IMAGES,
                );
            });
        }
    });
}
