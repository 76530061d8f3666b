//! Every environment of the table passes the public conformance suite, without pictures: they need OpenGL. That the
//! factors named here reach the model is tested beside `suite::Effect`.

use swm_core::EnvConfig;
use swm_core::testing::assert_conforms_with;
use swm_envs_mujoco::ENVS;

/// Factors that change nothing but pictures.
const ONLY_IN_PICTURES: &[&str] = &[
    "agent.cart_shape",
    "agent.color",
    "ball.color",
    "floor.color",
    "light.intensity",
    "spinner.color",
    // These change how the spinner turns, and nothing turns it here: see the test of the spinner in `suite.rs`.
    "spinner.density",
    "spinner.friction",
    "target.color",
    "target.shape",
];

#[test]
fn all_environments_conform() {
    for entry in ENVS {
        assert_conforms_with(entry, &EnvConfig::default(), ONLY_IN_PICTURES);
    }
}
