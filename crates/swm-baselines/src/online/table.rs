//! All agents. A new one is a folder next to this file and one line here.

use serde_json::{Map, Value as Json, json};
use swm_core::Setting;
use swm_core::error::nearest;

use super::agent::{AgentConfig, OnlineAgent, Task};
use super::{sac, tdmpc2};
use crate::device::Device;
use crate::error::BaselineError;
use crate::models::settings::with_changes;

/// A line of the table.
#[derive(Clone, Copy)]
pub struct AgentEntry {
    /// Its name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its presets, the published one first.
    pub presets: &'static [&'static str],
    /// Settings below `plan` that its policy takes, such as `tdmpc2:RUN,samples=64`.
    pub options: &'static [Setting],
    /// All settings, from a preset, the task, and changes.
    settings: fn(&str, &Task<'_>, &Json) -> Result<Json, BaselineError>,
    /// Makes it.
    make: fn(AgentConfig, Device) -> Result<Box<dyn OnlineAgent>, BaselineError>,
}

/// All agents.
pub const AGENTS: &[AgentEntry] = &[
    AgentEntry {
        name: sac::NAME,
        about: "agent: soft actor-critic, learns online from observations (`--env`)",
        presets: &["paper", "small"],
        options: &[],
        settings: sac::settings,
        make: |config, device| Ok(Box::new(sac::Sac::new(config, device)?)),
    },
    AgentEntry {
        name: tdmpc2::NAME,
        about: "agent: plans in the latent space of a world model that learns online (`--env`)",
        presets: &["paper", "small"],
        options: tdmpc2::OPTIONS,
        settings: tdmpc2::settings,
        make: |config, device| Ok(Box::new(tdmpc2::Tdmpc2::new(config, device)?)),
    },
];

/// A new agent with fresh weights, for observations and actions of such dims of the environment of `task`. `changes` are
/// settings that differ from the preset's, as nested objects.
///
/// # Errors
///
/// No such agent or preset, or an unknown or misfit setting.
pub fn make_agent(
    name: &str,
    preset: &str,
    changes: &Json,
    task: &Task<'_>,
    [observation_dim, action_dim]: [usize; 2],
    seed: u64,
    device: Device,
) -> Result<Box<dyn OnlineAgent>, BaselineError> {
    let entry = find(name)?;
    if !entry.presets.contains(&preset) {
        return Err(BaselineError::UnknownPreset {
            baseline: entry.name,
            preset: preset.to_owned(),
            known: entry.presets.join(", "),
        });
    }
    let (agent, preset) = (entry.name.to_owned(), preset.to_owned());
    let settings = (entry.settings)(&preset, task, changes)?;
    (entry.make)(AgentConfig { agent, preset, settings, observation_dim, action_dim, seed }, device)
}

/// The agent of a config, with its initial weights. `options` are settings of its plan that differ from the config's, by the names
/// in [`AgentEntry::options`].
///
/// # Errors
///
/// No such agent, or settings that it does not take.
pub fn restore_agent(
    config: &AgentConfig,
    options: &Map<String, Json>,
    device: Device,
) -> Result<Box<dyn OnlineAgent>, BaselineError> {
    let (entry, mut config) = (find(&config.agent)?, config.clone());
    if !options.is_empty() {
        config.settings = with_changes(entry.name, &config.settings, &json!({ "plan": options }))?;
    }
    (entry.make)(config, device)
}

pub(crate) fn find(name: &str) -> Result<&'static AgentEntry, BaselineError> {
    AGENTS.iter().find(|entry| entry.name == name).ok_or_else(|| {
        let names: Vec<&str> = AGENTS.iter().map(|entry| entry.name).collect();
        BaselineError::UnknownBaseline {
            name: name.to_owned(),
            nearest: nearest(name, names.iter().copied()),
            known: names.join(", "),
        }
    })
}
