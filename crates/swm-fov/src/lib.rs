//! Factors of variation: what may differ between episodes, declared once per environment as data.
//!
//! A [`FovSpace`] is an immutable table of [`Factor`]s and [`Constraint`]s. Each reset samples an assignment, a
//! [`Fov`]: the scenario of that episode. Every factor has a random stream of its own, so that varying one more
//! factor does not move the others.
//!
//! [`FactorEnv`] makes an environment of a table of factors and a [`Scene`]: what is simulated, rendered and observed.
//!
//! ```
//! use swm_core::{EpisodeSeed, ResetOptions, env::Episode};
//! use swm_fov::{Factor, FovSpace};
//!
//! let space = FovSpace::new(vec![
//!     Factor::rgb("block.color", [119, 136, 153]).doc("fill of the block"),
//!     Factor::scalar("block.scale", 20.0, 60.0, 30.0).doc("length of one cell, px"),
//! ]);
//! let options = ResetOptions::default().vary(["block.scale"]);
//! let fov = space.sample("swm/Example-v0", &Episode::new(EpisodeSeed::new(7), &options))?;
//! assert_eq!(fov.rgb("block.color"), [119, 136, 153]);
//! assert!((20.0..=60.0).contains(&fov.f64("block.scale")));
//! # Ok::<(), swm_core::EnvError>(())
//! ```

mod assignment;
mod colors;
mod describe;
mod factor;
mod factor_env;
mod scene;

pub use assignment::{Fov, FovError, SavedFov};
pub use colors::{ColorValues, color_values};
pub use describe::markdown;
pub use factor::{Constraint, Factor, FovSpace};
pub use factor_env::FactorEnv;
pub use scene::{Scene, SceneError};
