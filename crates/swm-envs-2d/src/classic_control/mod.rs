//! Gymnasium's classic control: CartPole, both MountainCars, Acrobot and Pendulum, with factors of variation.
//!
//! States and images are those of the *reference*, the Python package `stable-worldmodel` on Gymnasium 1.2.3. One
//! environment, [`env`], serves them all; a `task::Task` brings dynamics, factors, rendering and the rule of its expert.

mod acrobot;
mod cart_pole;
mod env;
mod math;
mod mountain_car;
mod pendulum;
mod policies;
mod settings;
mod task;
#[cfg(test)]
mod tests;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::FactorEnv;

use self::env::ClassicControl;
use self::task::Task;

/// `swm/CartPoleControl-v1`.
pub const CART_POLE: EnvEntry = entry::<cart_pole::CartPole>();
/// `swm/MountainCarControl-v0`.
pub const MOUNTAIN_CAR: EnvEntry = entry::<mountain_car::MountainCar>();
/// `swm/MountainCarContinuousControl-v0`.
pub const MOUNTAIN_CAR_CONTINUOUS: EnvEntry = entry::<mountain_car::MountainCarContinuous>();
/// `swm/AcrobotControl-v1`.
pub const ACROBOT: EnvEntry = entry::<acrobot::Acrobot>();
/// `swm/PendulumControl-v1`.
pub const PENDULUM: EnvEntry = entry::<pendulum::Pendulum>();

const fn entry<T: Task>() -> EnvEntry {
    EnvEntry::new(T::ID, T::SUMMARY, FactorEnv::<ClassicControl<T>>::boxed)
        .family("Classic control")
        .success(T::SUCCESS)
        .settings(settings::Settings::SETTINGS)
        .policies(policies::policies::<T>())
        .planner(T::PLANNER)
}
