//! Worlds to plan in: the toy environment and variations of it, run with a policy, and what was done in them.

use std::collections::BTreeMap;

use swm_core::env::{EnvConfig, EnvSpec, EnvState, Episode, Outcome};
use swm_core::testing::TOY;
use swm_core::{
    BoxError, Env, EnvEntry, EnvError, EpisodeEnd, LiveStep, Policy, Recorder, ResetOptions, Rollout,
    RowsMut, Slice, Value, World, WorldError, WorldOptions,
};

/// The toy environment, changed.
#[derive(Clone, Copy, PartialEq)]
enum Change {
    NoTaskCost,
    /// It has another name, and diverges when pushed by more than 0.8.
    Fragile,
}

pub(super) const NO_TASK_COST: EnvEntry =
    EnvEntry::new(TOY.id, TOY.summary, |config| changed(config, Change::NoTaskCost));
pub(super) const FRAGILE: EnvEntry =
    EnvEntry::new("swm/Fragile-v0", TOY.summary, |config| changed(config, Change::Fragile));

fn changed(config: &EnvConfig, change: Change) -> Result<Box<dyn Env>, EnvError> {
    let inner = TOY.make(config)?;
    let mut spec = inner.spec().clone();
    match change {
        Change::NoTaskCost => {}
        Change::Fragile => spec.id = FRAGILE.id.to_owned(),
    }
    Ok(Box::new(Changed { inner, spec, change }))
}

struct Changed {
    inner: Box<dyn Env>,
    spec: EnvSpec,
    change: Change,
}

impl Env for Changed {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }
    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.inner.reset(episode)
    }
    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        if self.change == Change::Fragile && action.as_f64(0).is_some_and(|push| push > 0.8) {
            return Err(EnvError::Diverged {
                env: self.spec.id.clone(),
                reason: "pushed too hard".to_owned(),
            });
        }
        self.inner.step(action)
    }
    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.inner.write_episode(out);
    }
    fn observe(&mut self, out: &mut RowsMut<'_>) {
        self.inner.observe(out);
    }
    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        self.inner.snapshot(state)
    }
    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        self.inner.restore(state)
    }
    fn task_cost(&self) -> Option<f64> {
        self.inner.task_cost().filter(|_| self.change != Change::NoTaskCost)
    }
}

/// What happened in one episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Story {
    /// The state at every step, the last included.
    pub(super) states: Vec<f64>,
    /// The action at every step but the last.
    pub(super) actions: Vec<f32>,
    pub(super) success: Option<bool>,
}

/// Remembers every episode, by index.
#[derive(Default)]
struct Stories(BTreeMap<u64, Story>);

impl Recorder for Stories {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let story = self.0.entry(row.episode.index).or_default();
        story.states.push(row.values.get::<f64>("state")?[0]);
        let action = row.values.at(row.values.schema().require("action")?);
        story.actions.extend(action.as_f64(0).map(|action| action as f32));
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        let story = self.0.entry(end.index).or_default();
        story.success = end.success;
        story.actions.pop();
        Ok(())
    }
}

/// How to run.
#[derive(Clone)]
pub(super) struct Setting {
    pub(super) entry: EnvEntry,
    pub(super) num_envs: usize,
    pub(super) threads: usize,
    pub(super) episodes: u64,
    pub(super) max_steps: u64,
    pub(super) reset: ResetOptions,
    /// One per episode, in place of `reset`.
    pub(super) each: Vec<ResetOptions>,
}

impl Default for Setting {
    fn default() -> Self {
        let (num_envs, threads, episodes, max_steps) = (1, 1, 1, 12);
        Self {
            entry: TOY,
            num_envs,
            threads,
            episodes,
            max_steps,
            reset: ResetOptions::default(),
            each: Vec::new(),
        }
    }
}

/// From 0 to `goal`, with unit gain.
pub(super) fn toward(goal: f64) -> ResetOptions {
    let place = |value: f64| Some(BTreeMap::from([("state".to_owned(), Value::vector(&[value]))]));
    ResetOptions { start: place(0.0), goal: place(goal), ..ResetOptions::default() }
}

pub(super) fn run(setting: &Setting, policy: impl Policy + 'static) -> Result<Vec<Story>, WorldError> {
    let options =
        WorldOptions::new(setting.num_envs).max_episode_steps(setting.max_steps).threads(setting.threads);
    let mut world = World::new(&setting.entry, options)?;
    world.set_policy(policy)?;
    let mut stories = Stories::default();
    let rollout = Rollout::new(0..setting.episodes).seed(7);
    let rollout = match setting.each.as_slice() {
        [] => rollout.options(setting.reset.clone()),
        each => rollout.each(each),
    };
    world.run(&rollout, &mut stories)?;
    Ok(stories.0.into_values().collect())
}
