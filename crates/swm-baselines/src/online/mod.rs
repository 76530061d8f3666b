//! Online learning: an agent collects episodes in an environment, learns from what it has collected, and is evaluated on its
//! way.
//!
//! | file | duty |
//! |---|---|
//! | `session` | a run: begin here |
//! | `learn`, `settings` | the loop |
//! | `agent`, `table` | what an agent is, and all of them |
//! | `sac` | soft actor-critic |
//! | `tdmpc2` | TD-MPC2: plans in the latent space of a world model |
//! | `training` | what agents share |
//! | `interface` | an environment's observations as a vector and an image, its actions as a vector |
//! | `dataset` | a dataset in place of an environment |
//! | `replay` | the dataset that grows, and the buffer that is sampled from |
//! | `run` | what a run's folder holds; the agent of a checkpoint |
//!
//! The loop knows agents as [`OnlineAgent`] alone: one is a folder next to these files, and a line of [`AGENTS`].

mod agent;
mod dataset;
#[cfg(test)]
mod dataset_tests;
mod interface;
mod learn;
mod replay;
mod run;
pub mod sac;
mod session;
mod settings;
mod table;
pub mod tdmpc2;
#[cfg(test)]
mod tests;
mod training;

pub use agent::{AgentConfig, Observation, OnlineAgent, Task, Transitions};
pub use dataset::LearnedData;
pub use interface::Interface;
pub use learn::OnlineState;
pub use run::{OnlineConfig, TrainedAgent, is_online, online_agent};
pub use session::{NewOnlineRun, OnlineTraining};
pub use settings::{CollectConfig, OnlineSettings};
pub use table::{AGENTS, AgentEntry, agent_of, find as find_agent, restore_agent};
