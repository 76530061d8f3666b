//! Every environment of the table passes the public conformance suite.

use swm_core::testing::assert_conforms;
use swm_envs_3d::ENVS;

#[test]
fn all_environments_conform() {
    for entry in ENVS {
        assert_conforms(entry);
    }
}
