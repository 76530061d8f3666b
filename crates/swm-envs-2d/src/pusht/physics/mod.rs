//! The dynamics of PushT: an agent pushes a block on a table between four walls.
//!
//! Nothing slides on: dynamic bodies are stopped at every substep and move only by what contacts (or, for a polygon
//! agent, the controller) give them. There is no friction, no bounce and no gravity. The dynamics are those of the
//! published environment, which runs on a general impulse engine, to about 1e-10 px over whole episodes: including
//! its ten unconverged solver sweeps, the order of its contacts, its contact memory and its single-precision
//! controller. What is absent is everything that such an engine has beyond that: joints, friction, callbacks. With the
//! feature `rapier`, `RapierSim` moves the same bodies by rapier2d, with friction.
//!
//! ```
//! use swm_envs_2d::pusht::physics::{ActionMode, BodyId, Placement, Setup, Sim};
//!
//! let mut sim = Sim::new(&Setup::default())?;
//! sim.place_exactly(&Placement::from([200.0, 265.0, 250.0, 250.0, 0.0]))?;
//! let fork = sim.clone();
//! while sim.control_step([1.0_f32, 0.0], ActionMode::Relative) == 0 {}
//! assert!(sim.position(BodyId::Block)[0] > fork.position(BodyId::Block)[0]);
//! # Ok::<(), swm_envs_2d::pusht::physics::PhysicsError>(())
//! ```
//!
//! | file | duty |
//! |---|---|
//! | `sim` | the substep, the control step, placing, reading |
//! | `world`, `shapes` | constants of an episode: masses, parts, walls |
//! | `bodies`, `controller` | motion, and the agent's drive |
//! | `broad_phase`, `tree` | which pairs are tested, in which order |
//! | `collide` | where a pair touches |
//! | `memory` | impulses remembered between substeps |
//! | `solver` | impulses from contacts |
//! | `math` | vectors, boxes, sine |
//! | `rapier` | the other engine |

mod bodies;
mod broad_phase;
mod collide;
mod controller;
mod math;
mod memory;
mod placement;
#[cfg(feature = "rapier")]
mod rapier;
mod shapes;
mod sim;
mod solver;
mod tree;
mod world;

#[cfg(test)]
mod tests;

pub(crate) use broad_phase::enlarged;
pub use controller::{ActionMode, ActionScalar};
pub(crate) use math::{Aabb, Rotation, Vec2, vec2};
pub use placement::Placement;
#[cfg(feature = "rapier")]
pub use rapier::{RapierSim, RapierState};
pub use shapes::{MAX_PARTS, Rectangle, Shape};
pub use sim::{Contact, SUBSTEPS, Sim, State, contact_count};
pub(crate) use solver::{ALLOWED_OVERLAP, OVERLAP_REMOVED};
pub(crate) use tree::prefers_second;
pub use world::{
    BodyId, BodySetup, MAX_SCALE, PhysicsError, SUBSTEP_SECONDS, Setup, WALL_RADIUS, WALL_SEGMENTS, Wall,
};
