//! All agents. A new one is a folder next to this file and one line here.

use serde_json::Value as Json;
use swm_core::error::nearest;

use super::agent::{AgentConfig, OnlineAgent};
use super::sac;
use crate::device::Device;
use crate::error::BaselineError;

/// A line of the table.
#[derive(Clone, Copy)]
pub struct AgentEntry {
    /// Its name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its presets, the published one first.
    pub presets: &'static [&'static str],
    /// All settings, from a preset, the environment's id, and changes.
    settings: fn(&str, &str, &Json) -> Result<Json, BaselineError>,
    /// Makes it.
    make: fn(AgentConfig, Device) -> Result<Box<dyn OnlineAgent>, BaselineError>,
}

/// All agents.
pub const AGENTS: &[AgentEntry] = &[AgentEntry {
    name: sac::NAME,
    about: "agent: soft actor-critic, learns online from observations (`--env`)",
    presets: &["paper", "small"],
    settings: sac::settings,
    make: |config, device| Ok(Box::new(sac::Sac::new(config, device)?)),
}];

/// A new agent with fresh weights, for observations and actions of such dims of the environment `env`. `changes` are
/// settings that differ from the preset's, as nested objects.
///
/// # Errors
///
/// No such agent or preset, or an unknown or misfit setting.
pub fn make_agent(
    name: &str,
    preset: &str,
    changes: &Json,
    env: &str,
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
    let settings = (entry.settings)(&preset, env, changes)?;
    (entry.make)(AgentConfig { agent, preset, settings, observation_dim, action_dim, seed }, device)
}

/// The agent of a config, with its initial weights.
///
/// # Errors
///
/// No such agent, or settings that it does not take.
pub fn restore_agent(config: &AgentConfig, device: Device) -> Result<Box<dyn OnlineAgent>, BaselineError> {
    (find(&config.agent)?.make)(config.clone(), device)
}

fn find(name: &str) -> Result<&'static AgentEntry, BaselineError> {
    AGENTS.iter().find(|entry| entry.name == name).ok_or_else(|| {
        let names: Vec<&str> = AGENTS.iter().map(|entry| entry.name).collect();
        BaselineError::UnknownBaseline {
            name: name.to_owned(),
            nearest: nearest(name, names.iter().copied()),
            known: names.join(", "),
        }
    })
}
