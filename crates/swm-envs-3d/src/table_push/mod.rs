//! TablePush3D: a pusher that slides over a table pushes an object to a goal.
//!
//! The task and its dynamics are this project's own: rapier3d steps the object and the pusher, whose motor has a limited force, so
//! that mass, friction, gravity and restitution decide how an object moves.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `settings`, `factors` | the environment and its tables |
//! | `state`, `body`, `physics` | what moves, its shapes, how it moves |
//! | `rendering` | images |
//! | `guidance`, `policies` | the expert |

mod body;
mod env;
mod factors;
mod guidance;
mod physics;
mod policies;
mod rendering;
mod settings;
mod state;
#[cfg(test)]
mod tests;

use swm_core::policies::{expert, noisy_expert};
use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use self::env::TablePush;
use self::policies::Expert;

/// `swm/TablePush3D-v0`.
pub const TABLE_PUSH: EnvEntry = EnvEntry::new(
    TablePush::ID,
    "push an object over a table to a goal by a pusher of limited force",
    FactorEnv::<TablePush>::boxed,
)
.family(crate::FAMILY)
.success("the object within `goal.radius` of the goal")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::<Expert, 2>(), noisy_expert::<Expert, 2>()])
.planner(policies::PLANNER);
