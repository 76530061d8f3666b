//! Every environment of the table passes the public conformance suite; what is lost at a start from a recorded step is listed here,
//! with the reason, and on the environment's page.

use swm_core::testing::{Exceptions, Inexact, assert_all_conform};
use swm_envs_3d::ENVS;

const EXCEPTIONS: &[(&str, Exceptions<'_>)] = &[
    (
        "swm/PFRocketLanding-v0",
        Exceptions {
            inexact: &[
                noise("observation", 0.5),
                noise("state", 0.5),
                noise("pixels", 255.0),
                noise("reward", 0.01),
                noise("task_cost", 3.0),
            ],
            ..Exceptions::NONE
        },
    ),
    // The object stands as at the start, and so does the pusher.
    (
        "swm/TablePush3D-v0",
        Exceptions {
            goal_image: [40, 200],
            inexact: &[Inexact {
                column: "goal_state",
                first: 1.0,
                later: 0.0,
                reason: "a goal is where the object is; pusher and angles are those of the start",
            }],
            ..Exceptions::NONE
        },
    ),
];

/// The throttle's noise is keyed by the seed and the steps since the reset.
const fn noise(column: &str, later: f64) -> Inexact<'_> {
    Inexact { column, first: 0.0, later, reason: "the throttle has other noise" }
}

#[test]
fn all_environments_conform() {
    assert_all_conform(ENVS, EXCEPTIONS);
}
