//! Trained models at work in environments: a cost for planners, a policy, and the lines of the table of policies.
//!
//! | file | duty |
//! |---|---|
//! | `scenes` | from infos to what models see |
//! | `cost` | a world model as the cost of plans |
//! | `goal_policy` | a policy that acts by itself |
//! | `latents` | a world model whose quality is measured without control |
//! | `policies` | `mpc:RUN`, `policy:RUN` and their arguments |

mod cost;
mod goal_policy;
mod latents;
mod policies;
mod scenes;

pub use cost::ModelCost;
pub use goal_policy::ModelPolicy;
pub use latents::{LatentModel, MODELS};
pub use policies::POLICIES;
