//! The two phases of a world, over all its slots: resets of the episodes that are due, and steps of the live ones.

use crate::batch::{RowsMut, Slice, Value};
use crate::checkpoint::Checkpoints;
use crate::env::{Episode, GOAL_IMAGE, ResetOptions, step_times};
use crate::error::{EnvError, WorldError};
use crate::run::{LiveEpisode, Margins, Progress, Slot};
use crate::seed::EpisodeSeed;
use crate::success::Judge;
use crate::threads::{Pace, Threads};
use crate::view::Frames;

use super::fields::CommonFields;

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
    /// Which slots step, `[N]`; `None`: all live ones.
    pub mask: Option<&'a [bool]>,
    pub reset: ResetRules<'a>,
}

/// Which options an episode gets, by slot and episode index.
pub(super) type OptionsOf<'a> = &'a (dyn Fn(usize, u64) -> &'a ResetOptions + Sync);

/// Checkpoints that have room for the states of this kind of environment, as one reset tells.
pub(super) fn checkpoints(slot: &mut Slot, every: usize) -> Result<Checkpoints, EnvError> {
    slot.env.reset(&Episode::new(EpisodeSeed::new(0), &ResetOptions::default()))?;
    slot.env.snapshot(&mut slot.saved)?;
    Ok(Checkpoints::for_states_of(slot.saved.bytes().len(), every))
}

/// Resets every slot that has a next episode.
pub(super) fn reset_all(
    slots: &mut [Slot],
    rows: &mut RowsMut<'_>,
    options: OptionsOf<'_>,
    rules: &ResetRules<'_>,
    threads: &Threads,
) -> Result<(), WorldError> {
    let due = slots.iter().filter(|slot| slot.next.is_some()).count();
    let reset = |index: usize, slot: &mut Slot, out: &mut RowsMut<'_>| match slot.next.take() {
        Some(next) => slot.reset(next, options(index, next.index), rules, out).map_err(at(index, next)),
        None => Ok(()),
    };
    if due <= 1 || threads.is_one() {
        for_each_slot(slots, rows, 0, usize::MAX, &reset)
    } else {
        threads.install(|| for_each_slot(slots, rows, 0, 1, &reset))
    }
}

/// Steps the live slots, each by its own of `actions` (`[N, …action shape]`).
pub(super) fn step_all(
    slots: &mut [Slot],
    rows: &mut RowsMut<'_>,
    actions: Slice<'_>,
    rules: &StepRules<'_>,
    pace: &mut Pace,
    threads: &Threads,
) -> Result<(), WorldError> {
    let dim = actions.len() / slots.len();
    pace.learn(slots.len(), threads, |part| {
        for_each_slot(slots, rows, 0, part, &|index, slot, out| match slot
            .live_episode()
            .filter(|_| rules.mask.is_none_or(|mask| mask[index]))
        {
            Some(episode) => {
                slot.step(actions.range(index * dim, dim), rules, out).map_err(at(index, episode))
            }
            None => Ok(()),
        })
    })
}

fn at(slot: usize, episode: LiveEpisode) -> impl Fn(EnvError) -> WorldError {
    move |source| WorldError::Env { slot, episode: episode.index, source }
}

/// Halves the slots until at most `part` are left. Slots and their rows are disjoint, so nothing is shared, and nothing
/// is allocated; if several fail, the lowest slot's error is returned, whatever the order in which they ran.
fn for_each_slot<F>(
    slots: &mut [Slot],
    rows: &mut RowsMut<'_>,
    first: usize,
    part: usize,
    work: &F,
) -> Result<(), WorldError>
where
    F: Fn(usize, &mut Slot, &mut RowsMut<'_>) -> Result<(), WorldError> + Sync,
{
    if slots.len() <= part.max(1) {
        return (0..)
            .zip(slots)
            .try_for_each(|(offset, slot)| work(first + offset, slot, rows.select(offset)));
    }
    let middle = slots.len() / 2;
    let (left, right) = slots.split_at_mut(middle);
    let (mut left_rows, mut right_rows) = rows.reborrow().split_at(middle);
    let (a, b) = rayon::join(
        || for_each_slot(left, &mut left_rows, first, part, work),
        || for_each_slot(right, &mut right_rows, first + middle, part, work),
    );
    a.and(b)
}

/// Writes an image of the goal that a reset was given.
fn show_goal(image: &Value, env: &str, out: &mut RowsMut<'_>) -> Result<(), EnvError> {
    let wrong = |reason: String| EnvError::Reset { env: env.to_owned(), reason };
    let index = out.schema().index(GOAL_IMAGE).ok_or_else(|| {
        wrong(
            "it has no images of goals, and `goal_image` gives one; render images, or leave it out"
                .to_owned(),
        )
    })?;
    let shape = out.schema().fields()[index].shape.clone();
    if image.shape != shape || !out.slice_mut(index).copy_from(image.data.as_slice()) {
        let found = (image.data.as_slice().dtype(), &image.shape);
        return Err(wrong(format!("`goal_image` is {} {:?}; it takes uint8 {shape:?}", found.0, found.1)));
    }
    Ok(())
}

impl Slot {
    fn reset(
        &mut self,
        mut episode: LiveEpisode,
        options: &ResetOptions,
        rules: &ResetRules<'_>,
        out: &mut RowsMut<'_>,
    ) -> Result<(), EnvError> {
        episode.seed = options.seed.unwrap_or(episode.seed);
        options.check_none(&self.env.spec().id)?;
        let outcome = self.env.reset(&Episode::new(episode.seed, options))?;
        self.env.write_episode(out);
        self.goal_image_is_given = options.goal_image.is_some();
        if let Some(image) = &options.goal_image {
            show_goal(image, &self.env.spec().id, out)?;
        }
        self.env.observe(out);
        if let Some(frames) = rules.frames {
            frames.show(episode, &mut self.scratch, out);
        }
        rules.fields.write_reset(out, episode);
        rules.fields.write_checkpoint(self.env.as_ref(), 0, &mut self.saved, out)?;
        let mut progress = Progress::start(episode, outcome.success);
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
    ) -> Result<(), EnvError> {
        let mut outcome = step_times(self.env.as_mut(), action, rules.frame_skip)?;
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
        let step = progress.episode.step;
        rules.reset.fields.write_checkpoint(self.env.as_ref(), step, &mut self.saved, out)
    }
}

impl Progress {
    /// Takes note of the observation in `out`, by the judge's measure; whether it is a success now.
    fn judged(&mut self, judge: &Judge, out: &mut RowsMut<'_>) -> bool {
        let margin = judge
            .margin(|column, element| out.slice_mut(column).as_slice().as_f64(element).unwrap_or(f64::NAN));
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
