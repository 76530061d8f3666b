//! One live environment: a `World` of one slot, who acts in it, and the way back.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::env::VARIATION_PREFIX;
use swm_core::view::Transform;
use swm_core::{
    Column, EnvConfig, EnvEntry, EpisodeEnd, Field, ImageSize, LiveEpisode, PolicyArgs, Registry,
    ResetOptions, SuccessRule, Value, World, WorldOptions,
};
use swm_tasks::request::TaskError;

use super::history::History;
use super::message::{Open, Reset};
use super::observed_policy::ObservedPolicy;
use super::planner::{Planner, Shown};
use super::steer::Steer;
use super::take::{Ending, Take};
use super::task::Task;

pub(super) struct Stage {
    pub entry: &'static EnvEntry,
    config: EnvConfig,
    pub world: World,
    limit: Option<u64>,
    frame_skip: u32,
    /// The pair of a manifest that every episode starts from.
    pair: Option<ResetOptions>,
    success: SuccessRule,
    transform: Option<Arc<dyn Transform>>,
    /// The run's seed, and which of its episodes.
    pub seed: u64,
    pub episode: u64,
    options: ResetOptions,
    hand: Vec<f64>,
    pointer: Option<[f64; 2]>,
    pub steer: Option<Steer>,
    policy: Option<PolicyArgs>,
    planner: Option<Planner>,
    /// What the policy did last.
    acted: Arc<Mutex<Option<Column>>>,
    /// Of every step of the episode.
    actions: Vec<Column>,
    actors: BTreeSet<String>,
    history: History,
    /// Columns to plot, as positions in the infos.
    watched: Vec<usize>,
}

/// One step in the plots.
#[derive(Debug, Serialize)]
pub(super) struct Point {
    step: u64,
    reward: f64,
    cost: Option<f64>,
    values: Vec<f64>,
}

/// Values of one plotted column at most, and of all.
const MAX_PLOTTED: usize = 32;

impl Stage {
    /// Makes the environment, and begins its first episode: as the page asks, or as `task` says, a manifest and one of its pairs.
    ///
    /// # Errors
    ///
    /// No such environment, a setting or image size that it refuses, what it needs is not installed, a reset that it refuses.
    pub(super) fn open(registry: &Registry, open: &Open, task: Option<&Task>) -> Result<Self, TaskError> {
        let manifest = task.map(|task| &task.manifest);
        let entry = registry.env(manifest.map_or(&open.env, |manifest| &manifest.env))?;
        // Policies see what they saw in the evaluation.
        let asked = ImageSize::new(open.image, open.image)?;
        let image = Some(manifest.and_then(|manifest| manifest.image).unwrap_or(asked));
        let settings = manifest.map_or(&open.settings, |manifest| &manifest.settings).clone();
        let config = EnvConfig { image, settings };
        let limit = manifest.map_or(open.max_steps, |manifest| Some(manifest.budget));
        let frame_skip = manifest.map_or(1, |manifest| manifest.frame_skip);
        let options =
            WorldOptions::new(1).env(config.clone()).max_episode_steps(limit).frame_skip(frame_skip);
        let mut world = World::new(entry, options)?;
        let success = manifest.map(|manifest| manifest.success.clone()).unwrap_or_default();
        world.set_success(&success)?;
        world.set_policy_seed(task.map_or(0, |task| task.policy_seed));
        let transform = task.and_then(|task| task.transform.clone());
        world.set_transform(transform.clone());
        let pair = match task {
            Some(Task { manifest, index, .. }) => {
                let pair = manifest.pairs.get(*index);
                Some(pair.ok_or_else(|| format!("the manifest has no pair {index}"))?.reset()?)
            }
            None => None,
        };
        let steer = Steer::measure(entry, &config)?;
        let hand = neutral(&world);
        let mut stage = Self {
            entry,
            config,
            world,
            limit,
            frame_skip,
            pair,
            success,
            transform,
            seed: manifest.map_or(0, |manifest| manifest.seed),
            episode: task.map_or(0, |task| task.index as u64),
            options: ResetOptions::default(),
            hand,
            pointer: None,
            steer,
            policy: None,
            planner: None,
            acted: Arc::default(),
            actions: Vec::new(),
            actors: BTreeSet::new(),
            history: History::default(),
            watched: Vec::new(),
        };
        let reset = if task.is_some() { &Reset::default() } else { &open.reset };
        stage.reset(registry, reset)?;
        Ok(stage)
    }

    /// Begins an episode. Where the environment refuses it, the last one begins again.
    ///
    /// # Errors
    ///
    /// Why it is refused: a constraint in words, a value out of bounds.
    pub(super) fn reset(&mut self, registry: &Registry, reset: &Reset) -> Result<(), TaskError> {
        let seed = reset.seed.unwrap_or(self.seed);
        let episode = reset.episode.unwrap_or(if seed == self.seed { self.episode } else { 0 });
        let set = reset.set.iter().map(|(name, value)| Ok((name.clone(), Value::from_json(name, value)?)));
        let mut options = self.pair.clone().unwrap_or_default();
        options.variation = reset.vary.clone().or(options.variation);
        options.variation_values.extend(set.collect::<Result<Vec<_>, TaskError>>()?);
        match self.begin(seed, episode, &options) {
            Ok(()) => (self.seed, self.episode, self.options) = (seed, episode, options),
            Err(refused) => {
                let last = self.options.clone();
                self.begin(self.seed, self.episode, &last).map_err(|_| "the environment cannot be reset")?;
                return Err(refused);
            }
        }
        self.attach(registry)
    }

    /// The next episode of the run, under the same options.
    pub(super) fn next_episode(&mut self, registry: &Registry) -> Result<(), TaskError> {
        let options = self.options.clone();
        self.begin(self.seed, self.episode + 1, &options)?;
        self.episode += 1;
        self.attach(registry)
    }

    fn begin(&mut self, seed: u64, episode: u64, options: &ResetOptions) -> Result<(), TaskError> {
        self.world.reset_slots(&[(0, LiveEpisode::of(seed, episode), options)])?;
        self.history.clear();
        self.actions.clear();
        self.actors.clear();
        self.history.push(self.world.save_slot(0)?);
        Ok(())
    }

    /// Lets a policy act, or whoever holds the pointer and the keys.
    ///
    /// # Errors
    ///
    /// No such policy, or it does not fit the environment. Whoever acted before goes on.
    pub(super) fn set_policy(
        &mut self,
        registry: &Registry,
        policy: Option<PolicyArgs>,
    ) -> Result<(), TaskError> {
        let before = std::mem::replace(&mut self.policy, policy);
        self.attach(registry).inspect_err(|_| self.policy = before)
    }

    /// As [`Stage::set_policy`], for one that the page chose: its noise comes from the episode alone.
    pub(super) fn choose_policy(
        &mut self,
        registry: &Registry,
        policy: Option<PolicyArgs>,
    ) -> Result<(), TaskError> {
        self.set_policy(registry, policy)?;
        self.world.set_policy_seed(0);
        Ok(())
    }

    /// Attaches the policy anew: what it remembers is of another past.
    fn attach(&mut self, registry: &Registry) -> Result<(), TaskError> {
        let Some(args) = &self.policy else {
            self.planner = None;
            return Ok(());
        };
        let mut inner = registry.policy_from(args, &self.world)?;
        let space = &self.world.spec().action;
        self.planner = Planner::of(inner.as_mut(), args, self.entry, &self.config, space, self.frame_skip)?;
        let starts = self.planner.as_ref().map(Planner::starts);
        self.world.set_policy(ObservedPolicy { inner, starts, last: Arc::clone(&self.acted) })?;
        Ok(())
    }

    /// The plan that the last step began, if it did.
    pub(super) fn plan(&mut self) -> Option<Shown> {
        self.planner.as_mut()?.take()
    }

    pub(super) fn is_over(&self) -> bool {
        self.end().is_some_and(|end| end.terminated || end.truncated)
    }

    pub(super) fn end(&self) -> Option<EpisodeEnd> {
        self.world.episode(0)
    }

    /// Who acts, in words.
    pub(super) fn actor(&self) -> String {
        match &self.policy {
            Some(_) => self.world.policy_description().unwrap_or_default(),
            None => "human".to_owned(),
        }
    }

    pub(super) fn set_hand(&mut self, values: Vec<f64>) -> Result<(), TaskError> {
        let dim = self.hand.len();
        if values.len() != dim || values.iter().any(|value| !value.is_finite()) {
            return Err(format!("an action has {dim} finite values, not {values:?}").into());
        }
        self.hand = values;
        Ok(())
    }

    pub(super) fn set_pointer(&mut self, at: Option<[f64; 2]>) {
        self.pointer = at.filter(|at| at.iter().all(|value| value.is_finite()));
    }

    /// One step by whoever acts.
    ///
    /// # Errors
    ///
    /// The policy fails, or the simulation does.
    pub(super) fn step(&mut self) -> Result<(), TaskError> {
        if self.is_over() {
            return Ok(());
        }
        let action = if self.policy.is_some() {
            self.world.step()?;
            let mut acted = self.acted.lock().unwrap_or_else(PoisonError::into_inner);
            acted.take().ok_or("the policy did not act")?
        } else {
            let action = self.action_by_hand()?;
            self.world.step_with(action.as_slice())?;
            action
        };
        self.actors.insert(self.actor());
        self.actions.push(action);
        self.history.push(self.world.save_slot(0)?);
        Ok(())
    }

    /// Where the agent is, as fractions of the image's width and height.
    pub(super) fn agent(&self) -> Option<[f64; 2]> {
        self.world.keypoints(0).first().map(|keypoint| keypoint.at)
    }

    fn action_by_hand(&self) -> Result<Column, TaskError> {
        let space = &self.world.spec().action;
        let agent = self.agent();
        let mut values = match (&self.steer, self.pointer, agent) {
            (Some(steer), Some(pointer), Some(agent)) => steer.action(agent, pointer).to_vec(),
            _ => self.hand.clone(),
        };
        let (low, high) = space.bounds();
        for (value, (low, high)) in values.iter_mut().zip(low.iter().zip(&high)) {
            *value = value.clamp(*low, *high);
        }
        let dtype = space.dtype().ok_or("actions of this kind cannot be given by hand")?;
        Ok(Value::vector(&values).cast("action", dtype, &space.shape())?.data)
    }

    /// Goes back to a step of the episode.
    ///
    /// # Errors
    ///
    /// The environment cannot restore its state.
    pub(super) fn rewind(&mut self, registry: &Registry, step: u64) -> Result<(), TaskError> {
        let step = step.min(self.actions.len() as u64);
        let saved = self.history.back_to(step).ok_or("the episode has not begun")?;
        let from = saved.step().unwrap_or(0);
        self.world.restore_slot(0, saved)?;
        self.actions.truncate(step as usize);
        // Where not every state is kept, the actions since lead there again.
        for action in &self.actions[from as usize..] {
            self.world.step_with(action.as_slice())?;
            self.history.push(self.world.save_slot(0)?);
        }
        self.attach(registry)
    }

    /// Everything that repeats the episode.
    pub(super) fn take(&self) -> Option<Take> {
        let end = self.end().filter(|end| end.steps > 0)?;
        let is_over = end.terminated || end.truncated;
        let limit = if is_over { self.limit } else { Some(end.steps) };
        Some(Take {
            entry: self.entry,
            config: self.config.clone(),
            limit,
            frame_skip: self.frame_skip,
            success: self.success.clone(),
            transform: self.transform.clone(),
            run_seed: self.seed,
            seed: end.seed,
            options: self.options.clone(),
            actions: self.actions.clone(),
            actors: self.actors.iter().cloned().collect::<Vec<_>>().join(" + "),
            end: Ending::from(&end),
        })
    }

    /// Chooses what is plotted; names that are no columns are left out.
    pub(super) fn watch(&mut self, columns: &[String]) {
        let schema = self.world.infos().schema();
        let mut left = MAX_PLOTTED;
        let fits = |index: &usize| {
            let dim = schema.dim(*index).min(MAX_PLOTTED);
            let fits = dim <= left;
            left -= if fits { dim } else { 0 };
            fits
        };
        self.watched = columns.iter().filter_map(|name| schema.index(name)).filter(fits).collect();
    }

    pub(super) fn point(&self) -> Point {
        let row = self.world.infos().row(0);
        let reward = row.get::<f64>("reward").map_or(f64::NAN, |reward| reward[0]);
        let values = self.watched.iter().flat_map(|&index| {
            let values = row.at(index);
            (0..values.len().min(MAX_PLOTTED)).map(move |i| values.as_f64(i).unwrap_or(f64::NAN))
        });
        let step = self.end().map_or(0, |end| end.steps);
        Point { step, reward, cost: self.world.task_cost(0), values: values.collect() }
    }

    /// The names of what [`Point::values`] holds: `state[2]`.
    pub(super) fn plotted(&self) -> Vec<String> {
        let schema = self.world.infos().schema();
        let names = self.watched.iter().flat_map(|&index| {
            let (name, dim) = (&schema.fields()[index].name, schema.dim(index));
            (0..dim.min(MAX_PLOTTED))
                .map(move |i| if dim == 1 { name.clone() } else { format!("{name}[{i}]") })
        });
        names.collect()
    }

    /// The factors of the episode.
    pub(super) fn factors(&self) -> Map<String, Json> {
        let row = self.world.infos().row(0);
        let fields = row.schema().fields().iter().enumerate();
        let factor = |(index, field): (usize, &Field)| {
            let name = field.name.strip_prefix(VARIATION_PREFIX)?;
            Some((name.to_owned(), Value::from_slice(&field.shape, row.at(index)).to_json()))
        };
        fields.filter_map(factor).collect()
    }

    /// The image, `[H, W, 3]`, with its height and width.
    pub(super) fn image(&self) -> (usize, usize, &[u8]) {
        self.image_of(swm_core::env::PIXELS).unwrap_or((0, 0, &[]))
    }

    /// The image of the goal, where the environment has one.
    pub(super) fn goal(&self) -> Option<(usize, usize, &[u8])> {
        self.image_of("goal")
    }

    fn image_of(&self, column: &str) -> Option<(usize, usize, &[u8])> {
        let infos = self.world.infos();
        let field = &infos.schema().fields()[infos.schema().index(column)?];
        let &[height, width, 3] = &field.shape[..] else { return None };
        Some((height, width, infos.get::<u8>(column).ok()?))
    }
}

/// The action that does nothing, or the nearest to it.
fn neutral(world: &World) -> Vec<f64> {
    let (low, high) = world.spec().action.bounds();
    low.iter().zip(high).map(|(&low, high)| 0f64.clamp(low, high)).collect()
}
