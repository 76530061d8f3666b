//! One environment of a `World`, the episode it is in, and the parallel phases over all of them.

use crate::batch::{RowsMut, Slice};
use crate::dataset::Checkpoints;
use crate::env::{Env, EnvState, Episode, ResetOptions, step_times};
use crate::error::{EnvError, WorldError};
use crate::evaluate::Judge;
use crate::pace::Pace;
use crate::policy::LiveEpisode;
use crate::recorder::Margins;
use crate::seed::EpisodeSeed;
use crate::view::{Frames, Scratch};

use super::fields::CommonFields;

/// An environment and where it is in the run.
pub(crate) struct Slot {
    env: Box<dyn Env>,
    /// The episode to begin at the next reset phase.
    pub(super) next: Option<LiveEpisode>,
    pub(super) progress: Option<Progress>,
    /// The last checkpoint.
    saved: EnvState,
    scratch: Scratch,
}

/// What is known of a running episode.
#[derive(Clone, Copy, Debug)]
pub(super) struct Progress {
    pub episode: LiveEpisode,
    pub total_reward: f64,
    pub success_at_start: Option<bool>,
    pub first_success_step: Option<u64>,
    pub success_now: Option<bool>,
    pub terminated: bool,
    pub truncated: bool,
    /// Under a judge: how near the goal was, and in how many rows on end it was reached.
    pub margins: Option<Margins>,
    pub streak: u64,
}

impl Progress {
    fn done(&self) -> bool {
        self.terminated || self.truncated
    }

    /// Takes note of the row in `out`, by the judge's measure; whether it is a success now.
    fn judged(&mut self, judge: &Judge, out: &mut RowsMut<'_>) -> bool {
        let margin = judge.margin(|column, element| number_in(out, column, element));
        let best = self.margins.map_or(margin, |margins| margins.best.min(margin));
        self.margins = Some(Margins { best, last: margin });
        let reached = margin < 1.0;
        self.streak = if reached { self.streak + 1 } else { 0 };
        if self.streak >= judge.hold() {
            self.first_success_step.get_or_insert(self.episode.step + 1 - self.streak);
        }
        reached
    }
}

impl Slot {
    pub(super) fn new(env: Box<dyn Env>) -> Self {
        Self { env, next: None, progress: None, saved: EnvState::new(), scratch: Scratch::default() }
    }

    /// Checkpoints that have room for the states of this kind of environment, as one reset tells.
    pub(super) fn checkpoints(&mut self, every: usize) -> Result<Checkpoints, EnvError> {
        self.env.reset(&Episode { seed: EpisodeSeed::new(0), options: &ResetOptions::default() })?;
        self.env.snapshot(&mut self.saved)?;
        Ok(Checkpoints::for_states_of(self.saved.bytes().len(), every))
    }

    pub(crate) fn env(&self) -> &dyn Env {
        self.env.as_ref()
    }

    /// The episode that needs an action, if any.
    pub(crate) fn live_episode(&self) -> Option<LiveEpisode> {
        self.progress.as_ref().filter(|progress| !progress.done()).map(|progress| progress.episode)
    }

    pub(crate) fn is_live(&self) -> bool {
        self.live_episode().is_some()
    }

    /// The finished episode, if it has not been collected yet.
    pub(super) fn finished(&self) -> Option<&Progress> {
        self.progress.as_ref().filter(|progress| progress.done())
    }

    fn reset(
        &mut self,
        options: &ResetOptions,
        rules: &ResetRules<'_>,
        out: &mut RowsMut<'_>,
    ) -> Result<(), WorldError> {
        let Some(mut episode) = self.next.take() else { return Ok(()) };
        episode.seed = options.seed.unwrap_or(episode.seed);
        let outcome = self
            .env
            .reset(&Episode { seed: episode.seed, options })
            .map_err(|source| WorldError::Env { row: 0, episode: episode.index, source })?;
        self.env.write_episode(out);
        self.env.observe(out);
        if let Some(frames) = rules.frames {
            frames.show(episode, &mut self.scratch, out);
        }
        rules.fields.write_reset(out, episode);
        rules
            .fields
            .write_checkpoint(self.env.as_ref(), 0, &mut self.saved, out)
            .map_err(|source| WorldError::Env { row: 0, episode: episode.index, source })?;
        let mut progress = Progress {
            episode,
            total_reward: 0.0,
            success_at_start: outcome.success,
            first_success_step: outcome.success.unwrap_or(false).then_some(0),
            success_now: outcome.success,
            terminated: false,
            truncated: false,
            margins: None,
            streak: 0,
        };
        if let Some(judge) = rules.judge {
            progress.first_success_step = None;
            let reached = progress.judged(judge, out);
            (progress.success_at_start, progress.success_now) = (Some(reached), Some(reached));
        }
        self.progress = Some(progress);
        Ok(())
    }

    fn step(
        &mut self,
        action: Slice<'_>,
        rules: &StepRules<'_>,
        out: &mut RowsMut<'_>,
    ) -> Result<(), WorldError> {
        let Some(episode) = self.live_episode() else { return Ok(()) };
        let mut outcome = step_times(self.env.as_mut(), action, rules.frame_skip)
            .map_err(|source| WorldError::Env { row: 0, episode: episode.index, source })?;
        self.env.observe(out);
        let progress = self.progress.as_mut().expect("a live slot has progress");
        progress.episode.step += 1;
        progress.total_reward += outcome.reward;
        if let Some(frames) = rules.reset.frames {
            frames.show(progress.episode, &mut self.scratch, out);
        }
        if let Some(judge) = rules.reset.judge {
            // An end without success stays an end.
            let ended = outcome.terminated && outcome.success != Some(true);
            outcome.success = Some(progress.judged(judge, out));
            outcome.terminated = ended || progress.first_success_step.is_some();
        } else if outcome.success == Some(true) {
            progress.first_success_step.get_or_insert(progress.episode.step);
        }
        progress.terminated = outcome.terminated;
        let is_over = rules.max_steps.is_some_and(|max| progress.episode.step >= max);
        progress.truncated = !outcome.terminated && (is_over || self.env.is_truncated());
        progress.success_now = outcome.success;
        rules.reset.fields.write_step(out, &outcome, progress);
        let row = progress.episode.step;
        rules
            .reset
            .fields
            .write_checkpoint(self.env.as_ref(), row, &mut self.saved, out)
            .map_err(|source| WorldError::Env { row: 0, episode: episode.index, source })
    }
}

/// What the reset phase needs to know.
pub(super) struct ResetRules<'a> {
    pub fields: CommonFields,
    pub judge: Option<&'a Judge>,
    pub frames: Option<&'a Frames>,
}

/// What the step phase needs to know.
pub(super) struct StepRules<'a> {
    pub frame_skip: u32,
    pub max_steps: Option<u64>,
    pub reset: ResetRules<'a>,
}

/// Element `element` of field `column` in the selected row.
fn number_in(out: &mut RowsMut<'_>, column: usize, element: usize) -> f64 {
    out.slice_mut(column).as_slice().number(element).unwrap_or(f64::NAN)
}

/// Which options a slot's next episode gets.
pub(super) trait Options: Sync {
    fn of(&self, episode: u64) -> &ResetOptions;
}

/// Resets every slot that has a next episode, in parallel.
pub(super) fn reset_all(
    slots: &mut [Slot],
    rows: RowsMut<'_>,
    options: &dyn Options,
    rules: &ResetRules<'_>,
) -> Result<(), WorldError> {
    if slots.iter().all(|slot| slot.next.is_none()) {
        return Ok(());
    }
    for_each_row(slots, rows, 0, 1, &|_, slot, out| match slot.next {
        Some(next) => slot.reset(options.of(next.index), rules, out),
        None => Ok(()),
    })
}

/// Steps every live slot by its row of `actions` (`[N, …action shape]`), in parallel.
pub(super) fn step_all(
    slots: &mut [Slot],
    rows: RowsMut<'_>,
    actions: Slice<'_>,
    rules: &StepRules<'_>,
    pace: &mut Pace,
) -> Result<(), WorldError> {
    let width = actions.len() / slots.len();
    pace.learn(slots.len(), |leaf| {
        for_each_row(slots, rows, 0, leaf, &|row, slot, out| {
            slot.step(actions.range(row * width, width), rules, out)
        })
    })
}

/// Halves the rows until at most `leaf` are left. Rows are disjoint, so nothing is shared, and nothing is
/// allocated; if several fail, the lowest row's error is returned, whatever the order in which they ran.
fn for_each_row<F>(
    slots: &mut [Slot],
    mut rows: RowsMut<'_>,
    first: usize,
    leaf: usize,
    work: &F,
) -> Result<(), WorldError>
where
    F: Fn(usize, &mut Slot, &mut RowsMut<'_>) -> Result<(), WorldError> + Sync,
{
    if slots.len() <= leaf.max(1) {
        for (offset, slot) in slots.iter_mut().enumerate() {
            let row = first + offset;
            work(row, slot, rows.select(offset)).map_err(|error| match error {
                WorldError::Env { episode, source, .. } => WorldError::Env { row, episode, source },
                other => other,
            })?;
        }
        return Ok(());
    }
    let middle = slots.len() / 2;
    let (left, right) = slots.split_at_mut(middle);
    let (left_rows, right_rows) = rows.split_at(middle);
    let (a, b) = rayon::join(
        || for_each_row(left, left_rows, first, leaf, work),
        || for_each_row(right, right_rows, first + middle, leaf, work),
    );
    a.and(b)
}
