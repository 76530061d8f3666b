//! Every environment of the table passes the public conformance suite; what is lost at a start from a recorded step, or is no part
//! of a goal, is listed here, with the reason, and on the environment's page.

use swm_core::testing::{Exceptions, Inexact, NoPart, assert_all_conform};
use swm_envs_2d::ENVS;

const EXCEPTIONS: &[(&str, Exceptions<'_>)] = &[
    ("swm/PushT-v1", PUSHT),
    ("swm/PushT-Discrete-v1", PUSHT),
    ("swm/PushTRapier-v0", PUSHT_RAPIER),
    (
        "swm/PointMaze-v0",
        Exceptions {
            no_part: &[NoPart { column: "goal_state", reason: "a goal is a place, without a velocity" }],
            ..Exceptions::NONE
        },
    ),
    (
        "swm/PendulumControl-v1",
        inexact(&[Inexact {
            column: "pixels",
            first: 255.0,
            later: 0.0,
            reason: "the arrow of the last torque is missing",
        }]),
    ),
    (
        "swm/SimpleNavigation-v0",
        inexact(&[goal_state("it ends with the goal of the agent that has reached it", 20.0)]),
    ),
    (
        "swm/TwoRoom-v1",
        inexact(&[
            overlap("n_contacts", 1.0),
            overlap("fraction_of_goal", 1.0),
            overlap("fraction_of_agent", 1.0),
        ]),
    ),
];

const fn inexact<'a>(inexact: &'a [Inexact<'a>]) -> Exceptions<'a> {
    Exceptions { inexact, ..Exceptions::NONE }
}

const fn goal_state(reason: &str, first: f64) -> Inexact<'_> {
    Inexact { column: "goal_state", first, later: 0.0, reason }
}

/// As in the reference, an episode begins without any.
const fn overlap(column: &str, first: f64) -> Inexact<'_> {
    Inexact { column, first, later: 0.0, reason: "0 at a reset" }
}

/// Contacts keep impulses from step to step, which push a little further; images show contacts.
const fn impulses(column: &str, first: f64, later: f64) -> Inexact<'_> {
    Inexact { column, first, later, reason: "impulses of contacts are not recorded" }
}

const PUSHT: Exceptions<'_> = inexact(&[
    impulses("block_pose", 0.0, 1.0),
    impulses("n_contacts", 0.0, 1.0),
    impulses("pixels", 255.0, 255.0),
    impulses("pos_agent", 0.0, 3.0),
    impulses("proprio", 0.0, 3.0),
    impulses("state", 0.0, 3.0),
    impulses("reward", 0.0, 3.0),
    impulses("task_cost", 1e-12, 3.0),
]);

const PUSHT_RAPIER: Exceptions<'_> = Exceptions {
    inexact: &[
        impulses("block_pose", 0.0, 3.0),
        impulses("n_contacts", 0.0, 1.0),
        impulses("pixels", 255.0, 255.0),
        impulses("pos_agent", 0.0, 5.0),
        impulses("proprio", 0.0, 5.0),
        impulses("vel_agent", 0.0, 5.0),
        impulses("state", 0.0, 5.0),
        impulses("reward", 0.0, 5.0),
        impulses("task_cost", 1e-12, 5.0),
    ],
    goal_image: [40, 40],
    ..Exceptions::NONE
};

#[test]
fn all_environments_conform() {
    assert_all_conform(ENVS, EXCEPTIONS);
}
