//! An agent's run, new or resumed, from environment or dataset to checkpoints.

use std::path::Path;
use std::time::Instant;

use serde_json::{Map, Value as Json};
use swm_core::env::PIXELS;
use swm_core::{Cancel, EnvConfig, EnvEntry, ImageSize, Registry, World, WorldOptions};
use swm_data::Dataset;

use super::agent::{AgentConfig, OnlineAgent, Task};
use super::dataset::{self, LearnedData};
use super::interface::Interface;
use super::learn::{Learn, OnlineState, Source};
use super::replay::Replay;
use super::run::OnlineConfig;
use super::settings::{CollectConfig, OnlineSettings};
use super::table::{AgentEntry, find, restore_agent};
use crate::device::Device;
use crate::error::BaselineError;
use crate::train::{Checkpoint, JsonLines, MetricSink, RunFolder, RunLock, TensorBoard};

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
    /// Settings of the environment; of a dataset, those that it was recorded with count.
    pub env_settings: Map<String, Json>,
    /// Columns that the agent observes, vectors and `pixels`; none: see [`Interface::new`]. In a dataset, the goal of a vector, such as
    /// `goal_state`, is what the episode reached; it is observed where none are named.
    pub observe: &'a [String],
    /// How long, and how often it is looked at.
    pub fit: OnlineSettings,
    /// What it is computed on: no part of the run, which may go on elsewhere.
    pub device: Device,
}

/// Learning that is ready to run. It holds the run's folder until it is dropped.
pub struct OnlineTraining {
    run: RunFolder,
    _lock: RunLock,
    agent: Box<dyn OnlineAgent>,
    config: OnlineConfig,
    held: Held,
}

/// What it learns from.
enum Held {
    /// Where it collects, and where it is evaluated.
    Worlds(Box<[World; 2]>),
    /// A dataset, whose episodes are read when it begins to learn.
    Dataset(Box<dyn Dataset>),
}

impl OnlineTraining {
    /// A new run in `folder`, which must hold none, in the environment `env`.
    ///
    /// # Errors
    ///
    /// A run is there already, settings that do not go together, or an environment that the agent cannot act in.
    pub fn create(folder: &Path, env: &EnvEntry, new: &NewOnlineRun<'_>) -> Result<Self, BaselineError> {
        let (entry, task) = (find(new.agent)?, Task::online(env.id, new.fit.max_episode_steps));
        let NewOnlineRun { env_settings, observe, fit, .. } = new;
        fit.check()?;
        let settings = entry.settings(new.preset, &new.changes, &task)?;
        let image = image(observe, entry, &settings)?;
        let interface = Interface::new(&world(env, 1, env_settings, image, fit.max_episode_steps)?, observe)?;
        let agent = new.agent(settings, &interface)?;
        let config = new.config(env.id, env_settings, interface, agent.as_ref());
        let held = Held::Worlds(Box::new(worlds(env, agent.as_ref(), &config)?));
        let (run, lock) = RunFolder::create(folder, &config)?;
        Ok(Self { _lock: lock, run, agent, config, held })
    }

    /// A new run in `folder`, which must hold none, that learns from a dataset: every step is an update.
    ///
    /// # Errors
    ///
    /// A run is there already, settings that do not go together, an agent that learns online alone, or a dataset that lacks what it
    /// needs.
    pub fn create_on(
        folder: &Path,
        dataset: &dyn Dataset,
        new: &NewOnlineRun<'_>,
    ) -> Result<Self, BaselineError> {
        let entry = find(new.agent)?;
        if !entry.learns_from_datasets {
            let reason = format!("{} learns online alone; name an environment", entry.name);
            return Err(BaselineError::Training { setting: "data".to_owned(), reason });
        }
        new.fit.check()?;
        let metadata = dataset.metadata().cloned().unwrap_or_default();
        let env = metadata.known_env().unwrap_or_default();
        let task = Task { from_dataset: true, ..Task::online(env, new.fit.max_episode_steps) };
        let settings = entry.settings(new.preset, &new.changes, &task)?;
        let image = image(new.observe, entry, &settings)?;
        let interface = dataset::interface(dataset, entry.name, new.observe, image)?;
        let agent = new.agent(settings, &interface)?;
        let mut config = new.config(env, &metadata.settings, interface, agent.as_ref());
        config.data = Some(LearnedData::of(dataset, &config.interface)?);
        dataset::check_length(dataset, agent.as_ref())?;
        let (run, lock) = RunFolder::create(folder, &config)?;
        Ok(Self { _lock: lock, run, agent, config, held: Held::Dataset(dataset.share()) })
    }

    /// Resumes the run in `folder`, in the environment that it was begun in, or on the dataset, which may have `moved`. `change` may
    /// alter how long it shall go on and how often it is looked at.
    ///
    /// # Errors
    ///
    /// There is no run, another process learns in it, its environment or dataset is not there or another, or `change` altered what
    /// must stay.
    pub fn resume(
        registry: &Registry,
        folder: &Path,
        device: Device,
        moved: Option<&Path>,
        change: impl FnOnce(&mut OnlineSettings),
    ) -> Result<Self, BaselineError> {
        let run = RunFolder::open(folder)?;
        let lock = run.lock()?;
        let known = OnlineConfig::read(&run)?;
        if known.imported.is_some() {
            return Err(
                run.wrong("it was imported, and what its optimizers remember is not known; make a new run")
            );
        }
        let mut config = known.clone();
        change(&mut config.fit);
        config.fit.check()?;
        let stays = |fit: &OnlineSettings| (fit.seed, fit.max_episode_steps);
        if stays(&known.fit) != stays(&config.fit) {
            return Err(run.wrong(
                "seed and length of episodes are those that it was begun with; make a new run to change them",
            ));
        }
        let agent = restore_agent(&config.agent, &Map::new(), device)?;
        let held = match (&mut config.data, moved) {
            (Some(data), _) => {
                if let Some(moved) = moved {
                    moved.clone_into(&mut data.path);
                }
                Held::Dataset(reopened(registry, &run, data, &config.interface, &config.agent.agent)?)
            }
            (None, Some(_)) => return Err(run.wrong("it learns online; leave `dataset` out")),
            (None, None) => {
                let env = registry.env(&config.env);
                let env = env.map_err(|error| run.wrong(format!("its environment: {error}")))?;
                let worlds = worlds(env, agent.as_ref(), &config)?;
                if Interface::new(&worlds[0], &config.interface.observed())? != config.interface {
                    return Err(run.wrong(format!(
                        "{} has other observations or actions than when it was begun; make a new run",
                        config.env
                    )));
                }
                Held::Worlds(Box::new(worlds))
            }
        };
        if known != config {
            run.check_longer(config.fit.steps)?;
            run.write_config(&config)?;
        }
        Ok(Self { run, _lock: lock, agent, config, held })
    }

    /// The agent.
    pub fn agent(&self) -> &dyn OnlineAgent {
        self.agent.as_ref()
    }

    /// What the run's `config.json` says.
    pub fn config(&self) -> &OnlineConfig {
        &self.config
    }

    /// What is in memory of a dataset, or what the replay buffer can come to hold: steps, and bytes.
    pub fn buffer_size(&self) -> [u64; 2] {
        let OnlineConfig { fit, interface, data, .. } = &self.config;
        let bytes = |rows: u64| rows.saturating_mul(interface.step_bytes() as u64);
        if let Some(data) = data {
            return [data.rows as u64, bytes(data.rows as u64)];
        }
        let collect = self.agent.collect();
        let CollectConfig { num_envs, capacity, .. } = *collect;
        // Episodes are collected whole, and each has a last observation.
        let episode_steps = collect.episode_steps(fit);
        let collected = fit.steps.saturating_add((num_envs as u64).saturating_mul(episode_steps));
        let rows = collected.saturating_add(collected / episode_steps).min(capacity as u64);
        [rows, bytes(rows)]
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
        let Self { run, agent, config, held, .. } = self;
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
            Box::new(TensorBoard::new(run, saved)),
        ];
        all.extend(sinks);
        let source = match held {
            Held::Dataset(dataset) => {
                let clips = dataset::read(dataset.as_ref(), &config.interface, agent.as_ref())?;
                Source::Dataset(Box::new(clips))
            }
            Held::Worlds(worlds) => {
                let ([world, stage], interface) = (&mut **worlds, &config.interface);
                let replay = Replay::open(&run.file(EPISODES), interface, agent.as_ref(), state.episodes)?;
                Source::Worlds { world, stage, interface, replay: Box::new(replay) }
            }
        };
        let learn = Learn {
            run,
            agent: agent.as_mut(),
            source,
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

impl NewOnlineRun<'_> {
    /// The agent, with its initial weights.
    fn agent(&self, settings: Json, interface: &Interface) -> Result<Box<dyn OnlineAgent>, BaselineError> {
        let config = AgentConfig {
            agent: self.agent.to_owned(),
            preset: self.preset.to_owned(),
            settings,
            observation_dim: interface.observation_dim,
            image: interface.image,
            action_dim: interface.action_dim(),
            seed: self.fit.seed,
        };
        restore_agent(&config, &Map::new(), self.device)
    }

    /// What the run's `config.json` will say.
    fn config(
        &self,
        env: &str,
        env_settings: &Map<String, Json>,
        interface: Interface,
        agent: &dyn OnlineAgent,
    ) -> OnlineConfig {
        OnlineConfig {
            env_settings: env_settings.clone(),
            fit: self.fit.clone(),
            ..OnlineConfig::new(agent.config().clone(), env.to_owned(), interface)
        }
    }
}

/// The side of the images that are observed, if they are.
fn image(observe: &[String], entry: &AgentEntry, settings: &Json) -> Result<Option<usize>, BaselineError> {
    observe.iter().any(|name| name == PIXELS).then(|| entry.image(settings)).transpose()
}

/// The dataset that a run was begun with, of which its agent sees what it saw.
fn reopened(
    registry: &Registry,
    run: &RunFolder,
    data: &LearnedData,
    interface: &Interface,
    agent: &str,
) -> Result<Box<dyn Dataset>, BaselineError> {
    let dataset = swm_data::open_with(registry, &data.path, &data.opening).map_err(|error| {
        run.wrong(format!("its dataset is not there: {error}; bring it back, or name its place as `dataset`"))
    })?;
    let mut found = LearnedData { path: data.path.clone(), ..LearnedData::of(dataset.as_ref(), interface)? };
    // Earlier versions did not record them.
    found.frame_skip = found.frame_skip.filter(|_| data.frame_skip.is_some());
    found.sample = found.sample.filter(|_| data.sample.is_some());
    let seen = || dataset::interface(dataset.as_ref(), agent, &interface.observed(), interface.image);
    match found == *data && seen()? == *interface {
        true => Ok(dataset),
        false => Err(run.wrong(format!(
            "{} is not the dataset that it was begun with; bring that one back, or name its place as `dataset`",
            data.path.display()
        ))),
    }
}

/// Where an agent collects, and where it is evaluated.
fn worlds(
    env: &EnvEntry,
    agent: &dyn OnlineAgent,
    config: &OnlineConfig,
) -> Result<[World; 2], BaselineError> {
    let image = config.interface.image;
    let (collect, fit) = (agent.collect(), &config.fit);
    let of = |num_envs, steps| world(env, num_envs, &config.env_settings, image, steps);
    Ok([of(collect.num_envs, collect.episode_steps(fit))?, of(1, fit.max_episode_steps)?])
}

/// Environments with images of this side, if any, on the caller's thread: an agent's updates take longer than its steps.
fn world(
    env: &EnvEntry,
    num_envs: usize,
    settings: &Map<String, Json>,
    image: Option<usize>,
    max_episode_steps: u64,
) -> Result<World, BaselineError> {
    let image = image.map(|side| ImageSize { height: side, width: side });
    let config = EnvConfig { image, settings: settings.clone() };
    let options = WorldOptions::new(num_envs).env(config).max_episode_steps(max_episode_steps);
    Ok(World::new(env, options.threads(1))?)
}
