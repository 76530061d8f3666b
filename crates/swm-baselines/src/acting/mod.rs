//! Trained models at work in environments: a cost for planners, and policies. `swm-checkpoints` makes them by name.
//!
//! | file | duty |
//! |---|---|
//! | `planning` | from infos to planning batches |
//! | `cost` | a world model as the cost of plans |
//! | `proposal` | plans that a policy over its latents proposes, where searches begin |
//! | `goal_policy` | a policy that acts directly |
//! | `agent_policy` | an agent that learned online |
//! | `canonical` | what draws images in the canonical look |
//! | `latents` | a world model for `swm quality` |

mod agent_policy;
mod canonical;
mod cost;
mod goal_policy;
mod latents;
mod planning;
mod proposal;

pub use agent_policy::AgentPolicy;
pub use canonical::CANONICAL;
pub use cost::{AGGREGATE, ModelCost};
pub use goal_policy::ModelPolicy;
pub use latents::LatentModel;
