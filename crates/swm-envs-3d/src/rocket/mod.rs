//! Rocket landing: a throttled, gimbaled engine and fins bring a falling rocket onto a pad.
//!
//! The model is that of PyFlyt 0.29.0 on PyBullet 3.2.7, which the *reference*, the Python package `stable-worldmodel`,
//! wraps. Free flight follows PyBullet's update formula (`flight`); parry3d finds what is near a body, and rapier3d
//! takes over the physics steps that touch (`contact`).

mod aerodynamics;
mod body;
mod contact;
mod env;
mod factors;
mod flight;
mod guidance;
mod policies;
mod rendering;
mod rules;
mod settings;
mod state;
#[cfg(test)]
mod tests;

use swm_core::policies::{expert, noisy_expert};
use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use self::env::RocketLanding;
use self::policies::Expert;
use self::state::ACTION_DIM;

/// `swm/PFRocketLanding-v0`.
pub const ROCKET_LANDING: EnvEntry = EnvEntry::new(
    RocketLanding::ID,
    "land a falling rocket on a pad by throttle, gimbal and fins",
    FactorEnv::<RocketLanding>::boxed,
)
.family(crate::FAMILY)
.success("upright with its legs on the pad, slower than 4 m/s")
.settings(settings::Settings::SETTINGS)
.policies(&[expert::<Expert, ACTION_DIM>(), noisy_expert::<Expert, ACTION_DIM>()])
.planner(policies::PLANNER);
