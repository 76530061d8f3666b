//! PushT: an agent pushes a block to a goal pose on a table with four walls.
//!
//! Observation, factors, goals and reward are the reference's; where it has faults, the page of the environment says
//! what is kept for parity and what is fixed.

mod discrete;
mod engine;
mod env;
mod expert;
mod factors;
mod goal;
pub mod physics;
mod rendering;
mod settings;
mod weak;

use self::physics::Sim;
use swm_core::{Actor, EnvEntry, PerEpisode, PolicyEntry, Settings as _, SlotView};
use swm_fov::{FactorEnv, Scene as _};

pub use discrete::{from_continuous, to_continuous};
pub use engine::Engine;
pub use env::PushT;
pub use factors::factors;
pub use goal::{PushTState, angle_error, is_success, observed_state, reward, task_cost};

/// `swm/PushT-v1`.
pub const PUSHT: EnvEntry = entry::<Sim, false>("push a block to a goal pose with a disc or polygon");

/// `swm/PushT-Discrete-v1`.
pub const PUSHT_DISCRETE: EnvEntry = entry::<Sim, true>("PushT with 16 × 16 polar actions");

/// `swm/PushTRapier-v0`.
#[cfg(feature = "rapier")]
pub const PUSHT_RAPIER: EnvEntry = entry::<physics::RapierSim, false>(
    "PushT on rapier2d, with friction and solid walls: to test robustness across physics engines",
);

const fn entry<E: Engine, const IS_DISCRETE: bool>(summary: &'static str) -> EnvEntry {
    let make = FactorEnv::<PushT<E, IS_DISCRETE>>::boxed;
    EnvEntry::new(PushT::<E, IS_DISCRETE>::ID, summary, make)
        .family(crate::FAMILY)
        .success("agent and block within 20 px of the goal, the block within 20°")
        .settings(settings::known::<E>())
        .policies(policies::<E>())
}

/// Policies that know PushT; the experts plan on the environment's own engine.
const fn policies<E: Engine>() -> &'static [PolicyEntry] {
    const { &[expert::expert::<E>(), expert::noisy_expert::<E>(), WEAK] }
}

const WEAK: PolicyEntry = PolicyEntry::new(
    "weak",
    "random pushes that stay near the block (the reference's WeakPolicy)",
    |context, args| {
        let WeakSettings { dist_constraint: reach_px } = args.parse_with("dist_constraint")?;
        if reach_px.is_nan() || reach_px <= 0.0 {
            return Err(args.wrong(format!("dist_constraint {reach_px} must be above 0")));
        }
        let relative = context.config.parse_settings::<settings::Settings>(context.env.id)?.relative;
        let make = move |_: &SlotView<'_>| Ok(Box::new(weak::Weak { reach_px, relative }) as Box<dyn Actor>);
        Ok(Box::new(PerEpisode::new(format!("weak:dist_constraint={reach_px}"), make)))
    },
)
.settings(WeakSettings::SETTINGS);

swm_core::settings! {
    /// Arguments of `weak`.
    struct WeakSettings {
        /// Largest distance of the target from the block, px per axis.
        dist_constraint: f64 = 100.0,
    }
}
