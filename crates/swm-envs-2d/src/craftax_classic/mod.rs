//! Craftax-Classic: an agent in a world of blocks collects, crafts, fights and sleeps, for 22 achievements.
//!
//! Worlds, steps and symbolic observations are those of the *reference*, the Python package `stable-worldmodel` (August 2026) on
//! Craftax 1.6.1 (Matthews et al., ICML 2024) and JAX, of which the random stream is the same, too.
//!
//! | file | duty |
//! |---|---|
//! | `env`, `factors` | the environment and its tables |
//! | `rules`, `state` | blocks, actions, achievements, constants; what changes in a game |
//! | `threefry` | JAX's random stream |
//! | `world` | how a world is made |
//! | `game`, `actions`, `mobs`, `spawning`, `vitals` | one step, by its parts |
//! | `observation` | the symbolic observation |
//! | `rendering`, `tiles` | images |
//! | `expert`, `shortest_path`, `policies` | the expert |

mod actions;
mod env;
mod expert;
mod factors;
mod game;
mod mobs;
mod observation;
mod policies;
mod rendering;
mod rules;
mod shortest_path;
mod spawning;
mod state;
#[cfg(test)]
mod tests;
mod threefry;
mod tiles;
mod vitals;
mod world;

use swm_core::{EnvEntry, Settings as _};
use swm_fov::{FactorEnv, Scene as _};

use crate::settings::FactorDefaults;
use env::CraftaxClassic;

/// `swm/CraftaxClassicSymbolic-v1`.
pub const CRAFTAX_CLASSIC_SYMBOLIC: EnvEntry = entry::<true>(
    "collect, craft and survive in a world of blocks, for 22 achievements; symbolic observations",
);

/// `swm/CraftaxClassicPixels-v1`.
pub const CRAFTAX_CLASSIC_PIXELS: EnvEntry = entry::<false>(
    "collect, craft and survive in a world of blocks, for 22 achievements; without symbolic observations",
);

const fn entry<const IS_SYMBOLIC: bool>(summary: &'static str) -> EnvEntry {
    let make = FactorEnv::<CraftaxClassic<IS_SYMBOLIC>>::boxed;
    EnvEntry::new(CraftaxClassic::<IS_SYMBOLIC>::ID, summary, make)
        .family("Worlds of blocks")
        .settings(FactorDefaults::SETTINGS)
        .policies(&[policies::EXPERT, policies::NOISY_EXPERT])
        .planner(policies::PLANNER)
}
