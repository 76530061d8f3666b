//! The dynamics of TwoRoom: a disc that is driven by velocity among fixed rectangles. It has no mass that matters: its
//! velocity is set anew in every substep, and walls act by correcting overlap only.
//!
//! | file | duty |
//! |---|---|
//! | `plan` | borders, wall pieces and doors of an episode, and the order in which their contacts are solved |
//! | `soft` | the reference's contacts: overlap is corrected a little per substep, so a strong push goes through |
//! | `solid` | truly solid walls: a swept disc that slides |
//! | `sim` | the substep, the control step, placing, saving |

mod plan;
mod sim;
mod soft;
mod solid;

pub(crate) use crate::pusht::physics::{Aabb, Vec2, vec2};
pub(super) use plan::{Axis, FloorPlan, INNER_PX, Opening, WALL_AT_PX};
pub(super) use sim::{MAX_ACTION_NORM, Setup, Sim, State, contact_count};
