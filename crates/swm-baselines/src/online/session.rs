//! An online run, new or resumed, from environment to checkpoints.

use std::path::Path;
use std::time::Instant;

use serde_json::{Map, Value as Json};
use swm_core::env::PIXELS;
use swm_core::{Cancel, EnvConfig, EnvEntry, ImageSize, Registry, World, WorldOptions};

use super::agent::{AgentConfig, OnlineAgent, Task};
use super::interface::Interface;
use super::learn::{Learn, OnlineState};
use super::replay::Replay;
use super::run::OnlineConfig;
use super::settings::{CollectConfig, OnlineSettings};
use super::table::{find, restore_agent};
use crate::device::Device;
use crate::error::BaselineError;
use crate::train::{Checkpoint, JsonLines, MetricSink, RUN_VERSION, RunFolder, RunLock, TensorBoard};

/// The run's dataset: every episode that was collected.
const EPISODES: &str = "episodes.h5";

/// What a new run is made from.
#[derive(Clone, Debug)]
pub struct NewOnlineRun<'a> {
    /// A line of [`super::AGENTS`].
    pub agent: &'a str,
    /// One of its presets.
    pub preset: &'a str,
    /// Settings of the agent that differ from the preset's, as nested objects; `null` for none.
    pub changes: Json,
    /// Settings of the environment.
    pub env_settings: Map<String, Json>,
    /// Columns that the agent observes, vectors and `pixels`; none: see [`Interface::new`].
    pub observe: &'a [String],
    /// How long, and how often it is looked at.
    pub fit: OnlineSettings,
    /// What it is computed on: no part of the run, which may go on elsewhere.
    pub device: Device,
}

/// Online learning that is ready to run. It holds the run's folder until it is dropped.
pub struct OnlineTraining {
    run: RunFolder,
    _lock: RunLock,
    agent: Box<dyn OnlineAgent>,
    config: OnlineConfig,
    /// Where it collects, and where it is evaluated.
    worlds: [World; 2],
}

impl OnlineTraining {
    /// A new run in `folder`, which must hold none, in the environment `env`.
    ///
    /// # Errors
    ///
    /// A run is there already, settings that do not go together, or an environment that the agent cannot act in.
    pub fn create(folder: &Path, env: &EnvEntry, new: &NewOnlineRun<'_>) -> Result<Self, BaselineError> {
        let NewOnlineRun { agent, preset, changes, env_settings, observe, fit, device } = new;
        fit.check()?;
        let entry = find(agent)?;
        let task = Task { env: env.id, max_episode_steps: fit.max_episode_steps };
        let settings = entry.settings(preset, changes, &task)?;
        let sees = observe.iter().any(|name| name == PIXELS);
        let image = sees.then(|| entry.image(&settings)).transpose()?;
        let interface = Interface::new(&world(env, 1, env_settings, image, fit)?, observe)?;
        let agent = AgentConfig {
            agent: entry.name.to_owned(),
            preset: (*preset).to_owned(),
            settings,
            observation_dim: interface.observation_dim,
            image: interface.image,
            action_dim: interface.action_dim(),
            seed: fit.seed,
        };
        let agent = restore_agent(&agent, &Map::new(), *device)?;
        let config = OnlineConfig {
            version: RUN_VERSION,
            agent: agent.config().clone(),
            env: env.id.to_owned(),
            env_settings: env_settings.clone(),
            interface,
            fit: fit.clone(),
        };
        let worlds = worlds(env, agent.as_ref(), &config)?;
        let run = RunFolder::create(folder, &config)?;
        Ok(Self { _lock: run.lock()?, run, agent, config, worlds })
    }

    /// Resumes the run in `folder`, in the environment that it was begun in. `change` may alter how long it shall go on and how
    /// often it is looked at.
    ///
    /// # Errors
    ///
    /// There is no run, another process learns in it, its environment is not there or another, or `change` altered what must
    /// stay.
    pub fn resume(
        registry: &Registry,
        folder: &Path,
        device: Device,
        change: impl FnOnce(&mut OnlineSettings),
    ) -> Result<Self, BaselineError> {
        let run = RunFolder::open(folder)?;
        let lock = run.lock()?;
        let known = OnlineConfig::read(&run)?;
        let mut config = known.clone();
        change(&mut config.fit);
        config.fit.check()?;
        let stays = |fit: &OnlineSettings| (fit.seed, fit.max_episode_steps);
        if stays(&known.fit) != stays(&config.fit) {
            return Err(run.wrong(
                "seed and length of episodes are those that it was begun with; make a new run to change them",
            ));
        }
        let env =
            registry.env(&config.env).map_err(|error| run.wrong(format!("its environment: {error}")))?;
        let agent = restore_agent(&config.agent, &Map::new(), device)?;
        let worlds = worlds(env, agent.as_ref(), &config)?;
        if Interface::new(&worlds[0], &config.interface.observed())? != config.interface {
            return Err(run.wrong(format!(
                "{} has other observations or actions than when it was begun; make a new run",
                config.env
            )));
        }
        if known != config {
            run.write_config(&config)?;
        }
        Ok(Self { run, _lock: lock, agent, config, worlds })
    }

    /// The agent.
    pub fn agent(&self) -> &dyn OnlineAgent {
        self.agent.as_ref()
    }

    /// What the run's `config.json` says.
    pub fn config(&self) -> &OnlineConfig {
        &self.config
    }

    /// What the replay buffer can come to hold: steps, and bytes.
    pub fn buffer_size(&self) -> [u64; 2] {
        let OnlineConfig { fit, interface, .. } = &self.config;
        let CollectConfig { num_envs, capacity, .. } = *self.agent.collect();
        // Episodes are collected whole, and each has a last observation.
        let collected = fit.steps.saturating_add((num_envs as u64).saturating_mul(fit.max_episode_steps));
        let rows = collected.saturating_add(collected / fit.max_episode_steps).min(capacity as u64);
        [rows, rows.saturating_mul(interface.step_bytes() as u64)]
    }

    /// Steps before the last checkpoint.
    ///
    /// # Errors
    ///
    /// The run's folder cannot be read.
    pub fn done(&self) -> Result<u64, BaselineError> {
        Ok(self.run.steps()?.last().copied().unwrap_or(0))
    }

    /// Learns to the end, and returns where that was. Records go to the run's folder and to `sinks`. Once `cancel` is set, the
    /// step at work is the last one, and a checkpoint follows it.
    ///
    /// # Errors
    ///
    /// A loss that is not finite, an environment that fails, or whatever committing episodes and writing checkpoints may meet.
    pub fn run(
        &mut self,
        sinks: Vec<Box<dyn MetricSink + '_>>,
        cancel: &Cancel,
    ) -> Result<OnlineState, BaselineError> {
        let Self { run, agent, config, worlds: [world, stage], .. } = self;
        let saved = run.steps()?.last().copied();
        let mut state = OnlineState::default();
        if let Some(step) = saved {
            let checkpoint: Checkpoint<OnlineState> = run.checkpoint(step)?;
            agent.load_weights(&run.checked_weights(&checkpoint)?)?;
            agent.load_training(&run.checked_training(&checkpoint)?)?;
            state = checkpoint.state;
        }
        let mut all: Vec<Box<dyn MetricSink + '_>> = vec![
            Box::new(JsonLines::after(run, saved.unwrap_or(0))?),
            Box::new(TensorBoard::new(run, saved)?),
        ];
        all.extend(sinks);
        let replay = Replay::open(&run.file(EPISODES), &config.interface, agent.as_ref(), state.episodes)?;
        let learn = Learn {
            run,
            agent: agent.as_mut(),
            world,
            stage,
            interface: &config.interface,
            replay,
            settings: &config.fit,
            sinks: &mut all,
            cancel,
            state,
            saved,
            started: Instant::now(),
            pace: (Instant::now(), 0),
        };
        learn.go()
    }
}

/// Where an agent collects, and where it is evaluated.
fn worlds(
    env: &EnvEntry,
    agent: &dyn OnlineAgent,
    config: &OnlineConfig,
) -> Result<[World; 2], BaselineError> {
    let image = config.interface.image;
    let of = |num_envs| world(env, num_envs, &config.env_settings, image, &config.fit);
    Ok([of(agent.collect().num_envs)?, of(1)?])
}

/// Environments with images of this side, if any, on the caller's thread: an agent's updates take longer than its steps.
fn world(
    env: &EnvEntry,
    num_envs: usize,
    settings: &Map<String, Json>,
    image: Option<usize>,
    fit: &OnlineSettings,
) -> Result<World, BaselineError> {
    let image = image.map(|side| ImageSize { height: side, width: side });
    let config = EnvConfig { image, settings: settings.clone() };
    let options = WorldOptions::new(num_envs).env(config).max_episode_steps(fit.max_episode_steps);
    Ok(World::new(env, options.threads(1))?)
}
