//! Trained models at work in environments: a cost for planners, a policy, and the lines of the table of policies.
//!
//! | file | duty |
//! |---|---|
//! | `planning` | from infos to planning batches |
//! | `cost` | a world model as the cost of plans |
//! | `proposal` | plans that a policy over its latents proposes, where searches begin |
//! | `goal_policy` | a policy that acts directly |
//! | `agent_policy` | an agent that learned online |
//! | `latents` | a world model for `swm quality` |
//! | `foreign` | published checkpoints in the place of runs |
//! | `given` | arguments that all policies of trained models share |
//! | `zoo` | `zoo:NAME`: models that are shipped |
//! | `policies` | `mpc:RUN`, `policy:RUN` and their arguments |

mod agent_policy;
mod canonical;
mod cost;
mod foreign;
mod given;
mod goal_policy;
mod latents;
mod planning;
mod policies;
mod proposal;
mod zoo;

pub use agent_policy::AgentPolicy;
pub use cost::ModelCost;
pub use goal_policy::ModelPolicy;
pub use latents::{LatentModel, MODELS};
pub use policies::POLICIES;
