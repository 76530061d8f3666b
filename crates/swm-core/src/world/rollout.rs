//! The one loop. It names exactly which episodes run; a slot whose episode ends takes the next index or idles.
//! No bias toward short episodes, no auto-reset modes.

use std::ops::Range;

use super::slot::{Options, Progress};
use super::{Slot, World};
use crate::env::ResetOptions;
use crate::error::WorldError;
use crate::policy::LiveEpisode;
use crate::recorder::{EpisodeEnd, LiveRow, Recorder, RunInfo};
use crate::seed::EpisodeSeed;

/// Which episodes to run, and how each is reset.
#[derive(Clone, Debug)]
pub struct Rollout<'a> {
    /// Episode indices. Running `0..10` and then `10..20` gives what `0..20` gives.
    pub episodes: Range<u64>,
    /// The run's seed.
    pub seed: u64,
    /// What every reset is asked for.
    pub scenario: Scenario<'a>,
}

/// Reset options by episode.
#[derive(Clone, Copy, Debug)]
pub enum Scenario<'a> {
    /// The same for all.
    Same(&'a ResetOptions),
    /// One per episode, by episode index.
    Each(&'a [ResetOptions]),
}

impl Options for Scenario<'_> {
    fn of(&self, episode: u64) -> &ResetOptions {
        match self {
            Scenario::Same(options) => options,
            Scenario::Each(all) => &all[episode as usize],
        }
    }
}

impl World {
    /// Runs the episodes of `rollout` under the attached policy, watched by `recorder`. What comes out does not depend on the number
    /// of environments and threads; the order in which the recorder sees rows of different episodes does.
    ///
    /// # Errors
    ///
    /// As [`World::reset`] and [`World::step`]; fewer reset options than episodes; whatever the recorder meets.
    pub fn run(&mut self, rollout: &Rollout<'_>, recorder: &mut dyn Recorder) -> Result<(), WorldError> {
        if let Scenario::Each(all) = rollout.scenario
            && (all.len() as u64) < rollout.episodes.end
        {
            return Err(WorldError::Option {
                option: "scenario",
                reason: format!("{} reset options for episodes {:?}", all.len(), rollout.episodes),
            });
        }
        // The whole loop moves to the world's threads at once, so that no step pays for a hand-over.
        let pool = std::sync::Arc::clone(&self.pool);
        pool.install(|| self.run_here(rollout, recorder))
    }

    fn run_here(&mut self, rollout: &Rollout<'_>, recorder: &mut dyn Recorder) -> Result<(), WorldError> {
        let policy = self.policy_description().ok_or(WorldError::NoPolicy)?;
        let schema = self.infos.schema().clone();
        let mut upcoming = rollout.episodes.clone();
        for slot in &mut self.slots {
            slot.progress = None;
            slot.next = upcoming.next().map(|index| begin(rollout.seed, index));
        }
        // The first reset and the first actions come before the recorder's start, so that a request that cannot be
        // met leaves no file behind.
        self.reset_and_act(&rollout.scenario)?;
        let renderer = self.slots.first().and_then(|slot| slot.env().renderer());
        let info = RunInfo {
            spec: &self.spec,
            schema: &schema,
            options: &self.options,
            rollout,
            policy: &policy,
            renderer: renderer.as_deref(),
        };
        recorder.start(&info).map_err(WorldError::Record)?;
        while self.slots.iter().any(Slot::is_live) {
            self.record_rows(recorder, Slot::is_live)?;
            self.step_phase()?;
            self.record_rows(recorder, |slot| slot.finished().is_some())?;
            for slot in &mut self.slots {
                let Some(progress) = slot.finished() else { continue };
                recorder.episode(&end_of(progress)).map_err(WorldError::Record)?;
                slot.progress = None;
                slot.next = upcoming.next().map(|index| begin(rollout.seed, index));
            }
            self.reset_and_act(&rollout.scenario)?;
        }
        recorder.finish().map_err(WorldError::Record)
    }

    /// Begins the episodes that are due, and asks the policy for the actions of all live rows.
    fn reset_and_act(&mut self, scenario: &Scenario<'_>) -> Result<(), WorldError> {
        self.reset_phase(scenario)?;
        if self.slots.iter().any(Slot::is_live) { self.act() } else { Ok(()) }
    }

    /// Shows the chosen rows to the recorder, in row order.
    fn record_rows(
        &self,
        recorder: &mut dyn Recorder,
        chosen: impl Fn(&Slot) -> bool,
    ) -> Result<(), WorldError> {
        for (row, slot) in self.slots.iter().enumerate() {
            if !chosen(slot) {
                continue;
            }
            let progress = slot.progress.as_ref().expect("chosen slots have an episode");
            let live = LiveRow {
                values: self.infos.row(row),
                episode: progress.episode,
                success: progress.success_now,
                env: slot.env(),
            };
            recorder.step(&live).map_err(WorldError::Record)?;
        }
        Ok(())
    }
}

fn begin(seed: u64, index: u64) -> LiveEpisode {
    LiveEpisode { index, seed: EpisodeSeed::of(seed, index), step: 0 }
}

fn end_of(progress: &Progress) -> EpisodeEnd {
    EpisodeEnd {
        index: progress.episode.index,
        seed: progress.episode.seed,
        steps: progress.episode.step,
        total_reward: progress.total_reward,
        success: progress.success_now.map(|_| progress.first_success_step.is_some()),
        success_at_start: progress.success_at_start,
        first_success_step: progress.first_success_step,
        margins: progress.margins,
        terminated: progress.terminated,
        truncated: progress.truncated,
    }
}
