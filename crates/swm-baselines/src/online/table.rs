//! All agents. A new one is a folder next to this file and one line here.

use serde_json::{Map, Value as Json, json};
use swm_core::Setting;
use swm_core::env::PIXELS;
use swm_core::error::nearest;

use super::agent::{AgentConfig, OnlineAgent, Task};
use super::settings::OnlineSettings;
use super::{sac, tdmpc2};
use crate::device::Device;
use crate::error::BaselineError;
use crate::models::bounds::check_bounds;
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
    /// Whether it also learns from datasets.
    pub learns_from_datasets: bool,
    /// Settings below `plan` that its policy takes, such as `tdmpc2:RUN,samples=64`.
    pub options: &'static [Setting],
    /// The side of the images that it can learn from, by its settings; `None`: it learns from vectors alone.
    image: fn(&Json) -> Option<usize>,
    /// All settings, from a preset, the task, and changes.
    settings: fn(&str, &Task<'_>, &Json) -> Result<Json, BaselineError>,
    /// Makes it.
    make: fn(AgentConfig, Device) -> Result<Box<dyn OnlineAgent>, BaselineError>,
}

/// All agents.
pub const AGENTS: &[AgentEntry] = &[
    AgentEntry {
        name: sac::NAME,
        about: "agent: soft actor-critic, learns online from the observations of an environment",
        presets: &["paper", "small"],
        learns_from_datasets: false,
        options: &[],
        image: |_| None,
        settings: sac::settings,
        make: |config, device| Ok(Box::new(sac::Sac::new(config, device)?)),
    },
    AgentEntry {
        name: tdmpc2::NAME,
        about: "agent: plans in the latent space of a world model that learns online, or from a dataset",
        presets: &["paper", "small"],
        learns_from_datasets: true,
        options: tdmpc2::OPTIONS,
        image: |settings| Some(settings["image"]["size"].as_u64()? as usize),
        settings: tdmpc2::settings,
        make: |config, device| Ok(Box::new(tdmpc2::Tdmpc2::new(config, device)?)),
    },
];

impl AgentEntry {
    /// All settings: those of a preset, with `changes` as nested objects.
    pub(super) fn settings(
        &self,
        preset: &str,
        changes: &Json,
        task: &Task<'_>,
    ) -> Result<Json, BaselineError> {
        if !self.presets.contains(&preset) {
            return Err(BaselineError::UnknownPreset {
                baseline: self.name,
                preset: preset.to_owned(),
                known: self.presets.join(", "),
            });
        }
        (self.settings)(preset, task, changes)
    }

    /// The side of the images that it can learn from, with these settings.
    ///
    /// # Errors
    ///
    /// [`BaselineError::Training`]: it learns from vectors alone.
    pub(super) fn image(&self, settings: &Json) -> Result<usize, BaselineError> {
        (self.image)(settings).ok_or_else(|| {
            let others = AGENTS.iter().filter(|entry| entry.learns_from_images()).map(|entry| entry.name);
            BaselineError::Training {
                setting: "observe".to_owned(),
                reason: format!(
                    "{} learns from vectors alone; leave `{PIXELS}` out, or train one that learns from images: {}",
                    self.name,
                    others.collect::<Vec<_>>().join(", ")
                ),
            }
        })
    }

    /// Whether it can learn from images.
    pub fn learns_from_images(&self) -> bool {
        let settings = (self.settings)(self.presets[0], &Task::online("", 1), &Json::Null);
        settings.is_ok_and(|settings| (self.image)(&settings).is_some())
    }
}

/// The agent of a config, new or stored, with its initial weights. `options` are settings of its plan that differ from the config's, by the names
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
    let dims = [
        ("observation_dim", config.observation_dim),
        ("action_dim", config.action_dim),
        ("image", config.image.unwrap_or(0)),
    ];
    check_bounds(&config.settings, &dims)
        .map_err(|reason| BaselineError::Settings { baseline: entry.name, reason })?;
    (entry.make)(config, device)
}

/// All settings of an agent of this name, from the paper's for datasets and `changes`.
///
/// # Errors
///
/// No such agent, or settings that it does not take.
pub fn agent_of(name: &str, env: &str, changes: &Json) -> Result<Json, BaselineError> {
    let task = Task { from_dataset: true, ..Task::online(env, OnlineSettings::default().max_episode_steps) };
    let entry = find(name)?;
    entry.settings(entry.presets[0], changes, &task)
}

/// The agent of this name.
///
/// # Errors
///
/// [`BaselineError::UnknownBaseline`].
pub fn find(name: &str) -> Result<&'static AgentEntry, BaselineError> {
    AGENTS.iter().find(|entry| entry.name == name).ok_or_else(|| {
        let names: Vec<&str> = AGENTS.iter().map(|entry| entry.name).collect();
        BaselineError::UnknownBaseline {
            name: name.to_owned(),
            nearest: nearest(name, names.iter().copied()),
            known: names.join(", "),
        }
    })
}
