//! Piecewise: an agent walks to a target over a floor of zones, each of which pushes it its own way.
//!
//! The dynamics are affine in each zone and differ between them: a small test of models that have to tell where they are. At
//! the scale of its 224-px image, as TwoRoom-v2, whose border, dots and image style it shares.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `settings`, `factors` | the environment and its tables |
//! | `zones` | how an agent moves |
//! | `rendering` | images |
//! | `expert` | policies |

mod env;
mod expert;
mod factors;
mod rendering;
mod settings;
#[cfg(test)]
mod tests;
mod zones;

use swm_core::policies::{expert, noisy_expert};
use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use self::env::Piecewise;
use self::expert::Expert;

/// `swm/Piecewise-v0`.
pub const PIECEWISE: EnvEntry = EnvEntry::new(
    Piecewise::ID,
    "walk to a target over zones that push the agent, each its own way",
    FactorEnv::<Piecewise>::boxed,
)
.family(crate::FAMILY)
.success("less than 16 px from the target")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::<Expert, 2>(), noisy_expert::<Expert, 2>()])
.planner(expert::PLANNER);
