//! Replaying one episode at a time: an environment without images that steps just as the recorded one did, and one
//! with images that takes over its state to draw.
//!
//! There are two because observing belongs to the recorded sequence (some environments count what happened since), while
//! drawing every row on the way would cost more than all of the rest.

use std::collections::BTreeMap;
use std::mem;

use swm_core::dataset::whole_episode;
use swm_core::env::step_times;
use swm_core::{Batch, Column, Env, EnvError, EnvState, Episode, EpisodeSeed, Schema, SliceMut, Value};

use super::Script;
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

/// Two environments, and where they are.
pub(super) struct Stage {
    sim: Box<dyn Env>,
    /// One row of its fields.
    observed: Batch,
    /// In the look of the clip.
    painter: Painter,
    /// In the canonical look, if there is one.
    canonical: Option<Painter>,
    /// States of rows of the clip, where images of them are wanted in two looks.
    kept: Kept,
    /// The episode and row at which `sim` stands.
    at: Option<(usize, usize)>,
    state: EnvState,
    columns: Recorded,
    /// Actions from `actions_from` on, of the episode at hand.
    actions: Column,
    actions_from: usize,
    pieces: Vec<u8>,
}

/// An environment with images.
struct Painter {
    env: Box<dyn Env>,
    /// One row of its fields.
    image: Batch,
}

/// Which image of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shown {
    /// That in the look of the clip.
    Look,
    /// That in the canonical look.
    Canonical,
}

/// States of rows, whose memory is reused.
#[derive(Default)]
struct Kept {
    states: Vec<([usize; 2], EnvState)>,
    len: usize,
}

impl Kept {
    /// Clips have fewer rows.
    const MOST: usize = 256;

    fn clear(&mut self) {
        self.len = 0;
    }

    fn get(&self, place: [usize; 2]) -> Option<&EnvState> {
        self.states[..self.len].iter().find(|(there, _)| *there == place).map(|(_, state)| state)
    }

    /// The memory for the state of a row.
    fn add(&mut self, place: [usize; 2]) -> &mut EnvState {
        if self.len == Self::MOST {
            self.clear();
        }
        if self.len == self.states.len() {
            self.states.push((place, EnvState::new()));
        }
        let (there, state) = &mut self.states[self.len];
        *there = place;
        self.len += 1;
        state
    }
}

/// Positions of the columns of the recording that the replay needs.
struct Recorded {
    action: usize,
    checkpoint: Option<usize>,
    /// Recorded columns of the state: (in the recording, in the environment's fields).
    start: Vec<(usize, usize)>,
}

impl Stage {
    pub(super) fn new(dataset: &dyn Dataset, script: &Script) -> Result<Self, DataError> {
        let refuse = |reason: String| DataError::request(dataset.path(), reason);
        let make = |config| script.entry.make(config).map_err(|error| refuse(error.to_string()));
        let sim = make(&script.sim)?;
        let row = |env: &dyn Env| {
            let schema = Schema::new(env.spec().fields.clone()).map_err(|error| refuse(error.to_string()))?;
            Ok::<_, DataError>(Batch::new(schema, 1))
        };
        let observed = row(sim.as_ref())?;
        let painter = || {
            let env = make(&script.painter)?;
            Ok::<_, DataError>(Painter { image: row(env.as_ref())?, env })
        };
        let canonical = match &script.canonical {
            None => None,
            Some(look) => {
                let mut canonical = painter()?;
                canonical.env.dress(look).map_err(|error| refuse(error.to_string()))?;
                Some(canonical)
            }
        };
        let schema = dataset.schema();
        let action = schema.require("action").map_err(|error| refuse(error.to_string()))?;
        let (recorded, wanted) = (&schema.fields()[action], &sim.spec().action);
        if Some(recorded.dtype) != wanted.dtype() || recorded.dim() != wanted.dim() {
            return Err(refuse(format!(
                "its action is {} {:?}, which `{}` does not take",
                recorded.dtype,
                recorded.shape,
                sim.spec().id
            )));
        }
        let mut start = Vec::new();
        for name in sim.spec().start_columns {
            if let (Some(there), Some(here)) = (schema.index(name), observed.schema().index(name))
                && schema.fields()[there] == observed.schema().fields()[here]
            {
                start.push((there, here));
            }
        }
        let checkpoint = script.checkpoints.and_then(|_| schema.index(swm_core::dataset::CHECKPOINT));
        let columns = Recorded { action, checkpoint, start };
        let actions = Column::zeros(recorded.dtype, 0);
        Ok(Self {
            sim,
            observed,
            painter: painter()?,
            canonical,
            kept: Kept::default(),
            at: None,
            state: EnvState::new(),
            columns,
            actions,
            actions_from: 0,
            pieces: Vec::new(),
        })
    }

    /// Renders what follows in another look: with these values of visual factors in place of the recorded ones.
    pub(super) fn dress(
        &mut self,
        dataset: &dyn Dataset,
        look: &BTreeMap<String, Value>,
    ) -> Result<(), DataError> {
        self.kept.clear();
        self.painter.env.dress(look).map_err(|error| DataError::request(dataset.path(), error))
    }

    /// Draws field `index` of a row into `out`. Rows up to `last` will be asked for next.
    pub(super) fn draw(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        [episode, row, last]: [usize; 3],
        (shown, index): (Shown, usize),
        out: &mut [u8],
    ) -> Result<(), DataError> {
        if self.canonical.is_none() {
            self.seek(dataset, script, episode, row, last)?;
            self.take_over(dataset, episode, row)?;
            self.painter.draw(index, out);
            return Ok(());
        }
        if self.kept.get([episode, row]).is_none() {
            self.seek(dataset, script, episode, row, last)?;
            let state = self.kept.add([episode, row]);
            let saved = self.sim.snapshot(state);
            if let Err(error) = saved {
                self.kept.clear();
                return Err(failed(dataset, episode, row, &error));
            }
        }
        let Self { painter, canonical, kept, .. } = self;
        let painter = match (shown, canonical) {
            (Shown::Canonical, Some(canonical)) => canonical,
            _ => painter,
        };
        let state = kept.get([episode, row]).expect("it was just kept");
        painter.env.restore(state).map_err(|error| failed(dataset, episode, row, &error))?;
        painter.draw(index, out);
        Ok(())
    }

    /// Draws field `index`, which is constant in an episode.
    pub(super) fn draw_episode(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
        near: usize,
        index: usize,
        out: &mut [u8],
    ) -> Result<(), DataError> {
        self.seek(dataset, script, episode, near, near)?;
        self.take_over(dataset, episode, near)?;
        let Painter { env, image } = &mut self.painter;
        env.write_episode(&mut image.rows_mut());
        out.copy_from_slice(image.rows_mut().at::<u8>(index));
        Ok(())
    }

    /// Puts the painter where the simulation is.
    fn take_over(&mut self, dataset: &dyn Dataset, episode: usize, row: usize) -> Result<(), DataError> {
        let Self { sim, painter, state, .. } = self;
        let moved = sim.snapshot(state).and_then(|()| painter.env.restore(state));
        moved.map_err(|error| failed(dataset, episode, row, &error))
    }

    /// Takes the simulation to a row: on from where it is, or from the checkpoint before.
    fn seek(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
        row: usize,
        last: usize,
    ) -> Result<(), DataError> {
        let len = dataset.episode_len(episode);
        // Other factors than the recorded ones are in no checkpoint.
        let checkpoints = script.checkpoints.filter(|_| script.factors.is_empty());
        let checkpoint = checkpoints.and_then(|checkpoints| checkpoints.before(row, len));
        let here = self.at.filter(|&(there, at)| there == episode && at <= row).map(|(_, at)| at);
        if here.is_none_or(|here| checkpoint.is_some_and(|checkpoint| here < checkpoint)) {
            let restored = match checkpoint {
                Some(checkpoint) => self.recall(dataset, script, episode, checkpoint)?,
                None => false,
            };
            if !restored && here.is_none() {
                self.rewind(dataset, script, episode)?;
            }
        }
        self.fetch_actions(dataset, episode, last.max(row))?;
        self.advance(dataset, script, row, script.verify)
    }

    /// Restores a checkpoint; `false` if the recording has none at this row.
    fn recall(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
        row: usize,
    ) -> Result<bool, DataError> {
        let mut pieces = mem::take(&mut self.pieces);
        let found = self.read_pieces(dataset, script, episode, row, &mut pieces);
        let restored = match found {
            Ok(Some(state)) => {
                self.at = None;
                let state = EnvState::from_bytes(state.to_vec());
                match self.sim.restore(&state) {
                    Ok(()) => {
                        self.at = Some((episode, row));
                        Ok(true)
                    }
                    Err(error) => Err(failed(dataset, episode, row, &error)),
                }
            }
            Ok(None) => Ok(false),
            Err(error) => Err(error),
        };
        self.pieces = pieces;
        self.forget_actions();
        restored
    }

    /// The state that was saved at `row`, a multiple of the checkpoints' distance, if it is whole.
    fn read_pieces<'a>(
        &self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
        row: usize,
        pieces: &'a mut Vec<u8>,
    ) -> Result<Option<&'a [u8]>, DataError> {
        let (Some(checkpoints), Some(column)) = (script.checkpoints, self.columns.checkpoint) else {
            return Ok(None);
        };
        if row + checkpoints.every() > dataset.episode_len(episode) {
            return Ok(None);
        }
        let steps = Steps { first: row, count: checkpoints.every(), stride: 1 };
        pieces.resize(steps.count * dataset.schema().dim(column), 0);
        dataset.read_column(column, episode, steps, SliceMut::U8(pieces))?;
        Ok(checkpoints.read(pieces))
    }

    /// Resets the simulation to the first row of an episode.
    pub(super) fn rewind(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
    ) -> Result<(), DataError> {
        self.at = None;
        self.forget_actions();
        let options = whole_episode(self.sim.spec(), dataset, episode);
        let mut options = options.map_err(|error| replay_error(dataset, episode, 0, error.to_string()))?;
        options.variation_values.extend(script.factors.clone());
        let seed = options.seed.unwrap_or(EpisodeSeed::new(0));
        self.sim.reset(&Episode::new(seed, &options)).map_err(|error| failed(dataset, episode, 0, &error))?;
        self.sim.write_episode(&mut self.observed.rows_mut());
        self.sim.observe(&mut self.observed.rows_mut());
        if script.verify {
            self.compare(dataset, script, episode, 0)?;
        }
        self.at = Some((episode, 0));
        Ok(())
    }

    /// Steps to a later row of the episode at hand. Checkpoints on the way are compared, if asked for.
    pub(super) fn advance(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        row: usize,
        verify: bool,
    ) -> Result<(), DataError> {
        let Some((episode, mut here)) = self.at else { return Ok(()) };
        self.fetch_actions(dataset, episode, row)?;
        let width = self.sim.spec().action.dim();
        while here < row {
            // If a step fails, the simulation is nowhere.
            self.at = None;
            let action = self.actions.as_slice().range((here - self.actions_from) * width, width);
            if !action.is_finite() {
                return Err(replay_error(dataset, episode, here, "the recorded action is not finite"));
            }
            step_times(self.sim.as_mut(), action, script.frame_skip)
                .map_err(|error| failed(dataset, episode, here, &error))?;
            self.sim.observe(&mut self.observed.rows_mut());
            here += 1;
            if verify && here.is_multiple_of(script.compared_rows()) {
                self.compare(dataset, script, episode, here)?;
            }
        }
        self.at = Some((episode, here));
        Ok(())
    }

    /// Compares the simulation with what was recorded at this row: the whole state, or, where other factors are set or no
    /// states were saved, the columns that make the start of an episode.
    fn compare(
        &mut self,
        dataset: &mut dyn Dataset,
        script: &Script,
        episode: usize,
        row: usize,
    ) -> Result<(), DataError> {
        const OTHER_SIMULATOR: &str =
            "the simulator, its version or its library is not the one that recorded";
        if script.factors.is_empty() && self.columns.checkpoint.is_some() {
            self.sim.snapshot(&mut self.state).map_err(|error| failed(dataset, episode, row, &error))?;
            let mut pieces = mem::take(&mut self.pieces);
            let recorded = self.read_pieces(dataset, script, episode, row, &mut pieces);
            let equal = recorded.map(|state| state.is_none_or(|state| state == self.state.bytes()));
            self.pieces = pieces;
            return match equal? {
                true => Ok(()),
                false => {
                    let reason = format!("the state is not the recorded one: {OTHER_SIMULATOR}");
                    Err(replay_error(dataset, episode, row, reason))
                }
            };
        }
        for &(there, here) in &self.columns.start {
            let field = &self.observed.schema().fields()[here];
            let mut recorded = Column::zeros(field.dtype, field.dim());
            let steps = Steps { first: row, count: 1, stride: 1 };
            dataset.read_column(there, episode, steps, recorded.as_slice_mut())?;
            if recorded.as_slice() != self.observed.column(here) {
                let names: Vec<_> = script.factors.keys().map(String::as_str).collect();
                let reason = match names.is_empty() {
                    true => format!("`{}` is not the recorded one: {OTHER_SIMULATOR}", field.name),
                    false => format!(
                        "with other values of {}, `{}` is not the recorded one: such factors change what happens and \
                         not only what is seen; leave them as recorded, or collect anew",
                        names.join(", "),
                        field.name
                    ),
                };
                return Err(replay_error(dataset, episode, row, reason));
            }
        }
        Ok(())
    }

    /// Reads the actions from the present row up to the one that leads to `row`.
    fn fetch_actions(
        &mut self,
        dataset: &mut dyn Dataset,
        episode: usize,
        row: usize,
    ) -> Result<(), DataError> {
        let Some((_, here)) = self.at else { return Ok(()) };
        let width = self.sim.spec().action.dim();
        let held = self.actions_from..self.actions_from + self.actions.len() / width.max(1);
        if here >= row || (held.contains(&here) && held.end >= row) {
            return Ok(());
        }
        self.actions.resize((row - here) * width);
        self.actions_from = here;
        let steps = Steps { first: here, count: row - here, stride: 1 };
        let read = dataset.read_column(self.columns.action, episode, steps, self.actions.as_slice_mut());
        if read.is_err() {
            self.forget_actions();
        }
        read
    }

    /// They belong to another episode.
    fn forget_actions(&mut self) {
        self.actions.clear();
        self.actions_from = 0;
    }
}

impl Painter {
    /// Draws field `index` of where it is.
    fn draw(&mut self, index: usize, out: &mut [u8]) {
        self.env.observe(&mut self.image.rows_mut());
        out.copy_from_slice(self.image.rows_mut().at::<u8>(index));
    }
}

fn failed(dataset: &dyn Dataset, episode: usize, row: usize, error: &EnvError) -> DataError {
    replay_error(dataset, episode, row, error.to_string())
}

fn replay_error(dataset: &dyn Dataset, episode: usize, row: usize, reason: impl Into<String>) -> DataError {
    DataError::Replay { path: dataset.path().to_owned(), episode, row, reason: reason.into() }
}
