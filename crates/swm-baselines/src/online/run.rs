//! What an online run's `config.json` says, and the agent of a checkpoint.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use super::agent::{AgentConfig, OnlineAgent};
use super::dataset::LearnedData;
use super::interface::Interface;
use super::learn::OnlineState;
use super::settings::OnlineSettings;
use super::table::restore_agent;
use crate::device::Device;
use crate::error::BaselineError;
use crate::train::{
    Checkpoint, Imported, RUN_VERSION, RunFolder, Which, descriptions, refuse_foreign, step_of,
};

/// An agent's run, but for its weights and episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct OnlineConfig {
    /// [`RUN_VERSION`].
    pub version: u32,
    /// The agent.
    pub agent: AgentConfig,
    /// The environment's id; empty where a dataset does not tell it.
    pub env: String,
    /// Its settings.
    pub env_settings: Map<String, Json>,
    /// The dataset that it learned from, where it did; then the environment is the one of the dataset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<LearnedData>,
    /// What of it the agent observes, and the bounds of actions.
    pub interface: Interface,
    /// How long, and how often it is looked at.
    pub fit: OnlineSettings,
    /// Where it is from, if it is a checkpoint of others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
}

impl OnlineConfig {
    /// That of an agent in an environment, or of one whose name is empty.
    pub fn new(agent: AgentConfig, env: String, interface: Interface) -> Self {
        Self {
            version: RUN_VERSION,
            agent,
            env,
            env_settings: Map::new(),
            data: None,
            interface,
            fit: OnlineSettings::default(),
            imported: None,
        }
    }

    /// That of a run.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is of a run on a dataset, or has a version that this program does not read.
    pub fn read(run: &RunFolder) -> Result<Self, BaselineError> {
        refuse_foreign(run)?;
        if !is_online(run)? {
            return Err(run.wrong("it trained a model, not an agent; use a run of an agent"));
        }
        let config: Self = run.config()?;
        if config.version != RUN_VERSION {
            let version = config.version;
            return Err(run.wrong(format!("it has version {version}, this program reads {RUN_VERSION}")));
        }
        let checked = config.fit.check().map_err(|error| error.to_string());
        let checked = checked.and_then(|()| config.interface.check(&config.agent));
        checked.map_err(|reason| run.damaged(&run.config_file(), &reason))?;
        Ok(config)
    }
}

impl OnlineConfig {
    /// What it learns in, or from: `in swm/PushT-v1`, `on a.h5`.
    pub fn place(&self) -> String {
        match &self.data {
            Some(data) => format!("on {}", data.path.display()),
            None => format!("in {}", self.env),
        }
    }
}

/// Whether a run learned online.
///
/// # Errors
///
/// Its `config.json` cannot be read.
pub fn is_online(run: &RunFolder) -> Result<bool, BaselineError> {
    Ok(online_agent(run)?.is_some())
}

/// The name of the agent that a run taught online, if it did.
///
/// # Errors
///
/// Its `config.json` cannot be read.
pub fn online_agent(run: &RunFolder) -> Result<Option<String>, BaselineError> {
    let config = run.config::<Json>()?;
    let name = |agent: &Json| agent["agent"].as_str().unwrap_or("AGENT").to_owned();
    Ok(config.get("agent").map(name))
}

/// A trained agent and what it must be used with.
#[non_exhaustive]
pub struct TrainedAgent {
    /// The agent.
    pub agent: Box<dyn OnlineAgent>,
    /// Its run.
    pub config: OnlineConfig,
    /// Settings of its plan that differ from the run's.
    pub options: Map<String, Json>,
    /// The checkpoint's step.
    pub step: u64,
    /// SHA-256 of its weights.
    pub weights: String,
}

impl TrainedAgent {
    /// Takes a checkpoint of the run in folder `path`, whose weights are those that were written, and of its plan the settings
    /// `options`: see [`AgentEntry::options`](super::AgentEntry::options).
    ///
    /// # Errors
    ///
    /// There is no run or no such checkpoint, its files are not those that were written, or the options do not fit it.
    pub fn open(
        path: &Path,
        which: Which,
        options: Map<String, Json>,
        device: Device,
    ) -> Result<Self, BaselineError> {
        let run = RunFolder::open(path)?;
        let config = OnlineConfig::read(&run)?;
        let checkpoint: Checkpoint<OnlineState> = run.checkpoint(find(&run, which)?)?;
        let mut agent = restore_agent(&config.agent, &options, device)?;
        agent.load_weights(&run.checked_weights(&checkpoint)?)?;
        Ok(Self { agent, config, options, step: checkpoint.step, weights: checkpoint.weights })
    }

    /// The files that an agent depends on.
    ///
    /// # Errors
    ///
    /// There is no run, or no such checkpoint.
    pub fn files(path: &Path, which: Which) -> Result<Vec<PathBuf>, BaselineError> {
        let run = RunFolder::open(path)?;
        Ok(vec![run.config_file(), run.weights(find(&run, which)?)])
    }

    /// The files that it takes beside [`TrainedAgent::files`] to open the agent in a copy of its run.
    ///
    /// # Errors
    ///
    /// There is no run, or no such checkpoint.
    pub fn companions(path: &Path, which: Which) -> Result<Vec<PathBuf>, BaselineError> {
        let run = RunFolder::open(path)?;
        descriptions(&run, find(&run, which)?, which)
    }
}

fn find(run: &RunFolder, which: Which) -> Result<u64, BaselineError> {
    step_of(run, which, |last| Ok(run.checkpoint::<OnlineState>(last)?.state.best))
}
