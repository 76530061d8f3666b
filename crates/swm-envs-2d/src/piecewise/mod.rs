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

use swm_core::EnvEntry;

pub use env::Piecewise;

/// `swm/Piecewise-v0`.
pub const PIECEWISE: EnvEntry = EnvEntry::new(
    "swm/Piecewise-v0",
    "walk to a target over zones that push the agent, each its own way",
    |config| Ok(Box::new(Piecewise::new(config)?)),
)
.family(crate::FAMILY)
.success("less than 16 px from the target")
.settings(settings::SETTINGS)
.policies(&[expert::EXPERT, expert::NOISY_EXPERT])
.planner(expert::PLANNER);
