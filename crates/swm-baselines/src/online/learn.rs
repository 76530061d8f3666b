//! The loop of online learning: collect a round of episodes, make the updates that are due for each of its steps, evaluate,
//! write a checkpoint. It goes on after a kill exactly where the last checkpoint stood.
//!
//! Time is counted in steps of the environment whose updates are done. Episodes are collected whole, ahead of it, so a
//! checkpoint never holds half an episode: the buffer is made again from the run's dataset.

use std::time::Instant;

use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use swm_core::dataset::DatasetRecorder;
use swm_core::{
    BoxError, Cancel, Column, Dtype, EpisodeEnd, LiveEpisode, LiveStep, Recorder, Rollout, World, WorldError,
};

use super::agent::{Observation, OnlineAgent};
use super::interface::Interface;
use super::replay::{Clips, Replay};
use super::settings::OnlineSettings;
use crate::error::BaselineError;
use crate::train::{End, MetricSink, Part, Record, RunFolder, Sums, values};

/// Where learning stands: what a checkpoint holds in addition to weights.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OnlineState {
    /// Steps of the environment whose updates are done.
    pub step: u64,
    /// Steps that have been collected.
    pub collected: u64,
    /// Episodes that have been collected: those of the run's dataset that belong to this checkpoint.
    pub episodes: u64,
    /// Sums of losses since the last record.
    losses: Sums,
    /// Sums over episodes that ended since the last record.
    ended: Sums,
    /// The last record's means, by name.
    pub train: Vec<(String, f64)>,
    /// Of the evaluation at this step; empty where there was none.
    pub evaluation: Vec<(String, f64)>,
    /// The step and mean return of the best evaluation.
    pub best: Option<(u64, f64)>,
    /// Whether and why learning is over.
    pub end: Option<End>,
}

impl OnlineState {
    /// That of weights that were trained elsewhere.
    pub fn imported() -> Self {
        Self {
            step: 0,
            collected: 0,
            episodes: 0,
            losses: Sums::default(),
            ended: Sums::default(),
            train: Vec::new(),
            evaluation: Vec::new(),
            best: None,
            end: Some(End::Complete),
        }
    }
}

/// What is learned from.
pub(super) enum Source<'a> {
    /// Episodes that the agent collects in `world`; it is evaluated in `stage`.
    Worlds { world: &'a mut World, stage: &'a mut World, interface: &'a Interface, replay: Box<Replay> },
    /// Those of a dataset: every step is an update, and nothing is evaluated.
    Dataset(Box<Clips>),
}

impl Source<'_> {
    fn clips(&mut self) -> &mut Clips {
        match self {
            Self::Worlds { replay, .. } => &mut replay.clips,
            Self::Dataset(clips) => clips,
        }
    }
}

/// Learning at work.
pub(super) struct Learn<'a, 's> {
    pub(super) run: &'a RunFolder,
    pub(super) agent: &'a mut dyn OnlineAgent,
    pub(super) source: Source<'a>,
    pub(super) settings: &'a OnlineSettings,
    pub(super) sinks: &'a mut [Box<dyn MetricSink + 's>],
    pub(super) cancel: &'a Cancel,
    pub(super) state: OnlineState,
    /// The step of the last checkpoint.
    pub(super) saved: Option<u64>,
    pub(super) started: Instant,
    /// When the last record was, and transitions that were learned from since then.
    pub(super) pace: (Instant, u64),
}

impl Learn<'_, '_> {
    /// Learns until all steps are done, or until `cancel` is set.
    pub(super) fn go(mut self) -> Result<OnlineState, BaselineError> {
        self.state.end = None;
        loop {
            if self.state.step >= self.settings.steps {
                self.state.end = Some(End::Complete);
                return Ok(self.state);
            }
            if self.cancel.is_cancelled() {
                if self.saved != Some(self.state.step) {
                    self.save()?;
                }
                self.state.end = Some(End::Interrupted);
                return Ok(self.state);
            }
            if self.state.step < self.state.collected {
                self.step()?;
            } else {
                self.collect()?;
            }
        }
    }

    /// Collects an episode in each environment. One that is cut short by `cancel` leaves no trace in the state.
    fn collect(&mut self) -> Result<(), BaselineError> {
        let Self { agent, source, settings, cancel, state, .. } = self;
        let Source::Worlds { world, interface, replay, .. } = source else {
            // A dataset is there as a whole.
            state.collected = settings.steps;
            return Ok(());
        };
        let collect = agent.collect().clone();
        let mut random_left = collect.random_steps.saturating_sub(state.collected);
        let last = state.episodes + collect.num_envs as u64;
        let rollout = Rollout::new(state.episodes..last).seed(settings.seed).cancel(*cancel);
        let mut ends = Ends::default();
        let ran = drive(
            world,
            &rollout,
            &mut (DatasetRecorder::new(&mut **replay), &mut ends),
            interface,
            |slot, episode, observation, action| {
                if random_left == 0 {
                    return agent.act(slot, episode, true, observation, action);
                }
                random_left -= 1;
                let mut stream = episode.seed.indexed("agent random", [episode.step, 0]);
                action.iter_mut().for_each(|value| *value = stream.random_range(-1.0..=1.0));
                Ok(())
            },
        );
        match ran {
            Err(BaselineError::World(WorldError::Cancelled)) => return Ok(()),
            ran => ran?,
        }
        agent.observe(&replay.take_observed());
        state.episodes = last;
        state.collected += ends.0.iter().map(|end| end.steps).sum::<u64>();
        for end in &ends.0 {
            let of_episode = [("episode_return", end.total_reward), ("episode_steps", end.steps as f64)];
            state.ended.add(&of_episode.map(|(name, value)| (name.to_owned(), value)), 1.0);
        }
        Ok(())
    }

    /// Makes the updates that are due for one collected step, and looks at the agent if it is time to.
    fn step(&mut self) -> Result<(), BaselineError> {
        let (collect, before) = (self.agent.collect(), self.state.step);
        let [from, to] = match self.source {
            Source::Worlds { .. } => [before, before + 1].map(|step| collect.updates_at(step)),
            Source::Dataset(_) => [before, before + 1],
        };
        let size = self.agent.batch();
        for index in from..to {
            let clips = self.source.clips().sample(size, index)?;
            let losses = match self.agent.update(&clips, index) {
                Err(source @ BaselineError::NotFinite { .. }) => {
                    let kept = self.saved.map(|step| self.run.weights(step));
                    return Err(BaselineError::Stopped { kept, source: Box::new(source) });
                }
                losses => losses?,
            };
            self.state.losses.add(&values(&losses), 1.0);
            self.pace.1 += size as u64;
        }
        self.state.step += 1;
        self.state.evaluation.clear();
        let (step, total) = (self.state.step, self.settings.steps);
        self.sinks.iter_mut().for_each(|sink| sink.step(step, total));
        if step.is_multiple_of(self.settings.log_every) || step == total {
            let mut train = self.state.losses.take();
            train.extend(self.state.ended.take());
            if let Source::Worlds { replay, .. } = &self.source {
                train.push(("episodes".to_owned(), self.state.episodes as f64));
                train.push(("buffer".to_owned(), replay.clips.rows() as f64));
            }
            self.state.train.clone_from(&train);
            self.tell(Part::Train, train)?;
        }
        if step.is_multiple_of(self.settings.eval_every) || step == total {
            self.look()?;
        }
        Ok(())
    }

    /// Evaluates, and writes a checkpoint.
    fn look(&mut self) -> Result<(), BaselineError> {
        let Self { agent, source, settings, state, .. } = self;
        if let Source::Worlds { stage, interface, .. } = source {
            // Episodes of a run with another seed: none of them is learned from.
            let rollout = Rollout::new(0..settings.eval_episodes).seed(!settings.seed);
            let mut ends = Ends::default();
            drive(stage, &rollout, &mut ends, interface, |slot, episode, observation, action| {
                agent.act(slot, episode, false, observation, action)
            })?;
            state.evaluation = ends.summary();
            let value = state.evaluation[0].1;
            if state.best.is_none_or(|(_, best)| value > best) {
                state.best = Some((state.step, value));
            }
        }
        if state.step >= settings.steps {
            state.end = Some(End::Complete);
        }
        if !self.state.evaluation.is_empty() {
            self.tell(Part::Evaluation, self.state.evaluation.clone())?;
        }
        self.save()
    }

    /// Writes a checkpoint, and removes those that are no longer kept.
    fn save(&mut self) -> Result<(), BaselineError> {
        for sink in &mut *self.sinks {
            sink.flush()?;
        }
        let Self { run, agent, state, .. } = self;
        let (weights, training) = (&**agent, &**agent);
        run.write_checkpoint(
            state.step,
            |path| weights.save_weights(path),
            |path| training.save_training(path),
            state,
        )?;
        self.saved = Some(state.step);
        run.tidy(self.settings.keep, state.best.map(|(step, _)| step))
    }

    fn tell(&mut self, part: Part, values: Vec<(String, f64)>) -> Result<(), BaselineError> {
        let (since, clips) = self.pace;
        let record = Record {
            part,
            phase: match self.source {
                Source::Worlds { .. } => "online".to_owned(),
                Source::Dataset(_) => "dataset".to_owned(),
            },
            step: self.state.step,
            total: self.settings.steps,
            epoch: 0,
            values,
            clips_per_s: clips as f64 / since.elapsed().as_secs_f64().max(1e-9),
            elapsed: self.started.elapsed(),
        };
        self.pace = (Instant::now(), 0);
        // At once, for those who watch the curves: records are seconds apart.
        self.sinks.iter_mut().try_for_each(|sink| {
            sink.record(&record)?;
            sink.flush()
        })
    }
}

/// Runs the episodes of a rollout, with actions that `choose` writes for each live slot, in [-1, 1].
fn drive(
    world: &mut World,
    rollout: &Rollout,
    recorder: &mut dyn Recorder,
    interface: &Interface,
    mut choose: impl FnMut(usize, &LiveEpisode, &Observation<'_>, &mut [f32]) -> Result<(), BaselineError>,
) -> Result<(), BaselineError> {
    let space = world.spec().action.clone();
    let map = interface.action_map(&space)?;
    let dim = map.dim();
    let mut actions = Column::zeros(space.dtype().unwrap_or(Dtype::F32), world.options().num_envs * dim);
    let (mut vector, mut action) = (Vec::new(), vec![0.0; dim]);
    let mut run = world.begin(rollout, recorder)?;
    while let Some(view) = run.needs_actions() {
        for slot in view.live() {
            let Some(live) = view.row(slot) else { continue };
            let observation = interface.observe(live.row, &mut vector)?;
            choose(slot, &live.episode, &observation, &mut action)?;
            let (_, mut of_slot) = actions.as_slice_mut().split_at(slot * dim);
            map.write(&action, &mut of_slot.reborrow().split_at(dim).0);
        }
        run.set_actions(actions.as_slice())?;
        run.advance()?;
    }
    Ok(())
}

/// How episodes ended.
#[derive(Default)]
struct Ends(Vec<EpisodeEnd>);

impl Ends {
    /// Mean, least and greatest return, and the success rate where the task has success.
    fn summary(&self) -> Vec<(String, f64)> {
        let returns = || self.0.iter().map(|end| end.total_reward);
        let count = self.0.len() as f64;
        let mut summary = vec![
            ("return".to_owned(), returns().sum::<f64>() / count),
            ("return_min".to_owned(), returns().fold(f64::INFINITY, f64::min)),
            ("return_max".to_owned(), returns().fold(f64::NEG_INFINITY, f64::max)),
        ];
        if self.0.iter().all(|end| end.success.is_some()) {
            let solved = self.0.iter().filter(|end| end.success == Some(true)).count();
            summary.push(("success_rate".to_owned(), solved as f64 / count));
        }
        summary
    }
}

impl Recorder for Ends {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.0.push(*end);
        Ok(())
    }
}
