//! Going back: the state of one slot amid an episode, and the return to it.

use serde::{Deserialize, Serialize};

use super::World;
use crate::batch::{Column, Dtype, Field};
use crate::env::{EnvState, GOAL_IMAGE};
use crate::error::WorldError;
use crate::run::{Progress, Slot};

/// One slot of a [`World`] amid an episode: what [`World::restore_slot`] goes back to. Holds no images. It can be serialized, for the
/// same build of the program.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SavedSlot {
    state: EnvState,
    /// The last checkpoint of the recording, if states are saved.
    checkpoint: EnvState,
    progress: Option<Progress>,
    /// The row of the infos, without what a policy reports; none where a column holds images, which are rendered again, but for an
    /// image of the goal that was given.
    values: Vec<Option<Column>>,
}

impl SavedSlot {
    /// Its size in memory, about.
    pub fn bytes(&self) -> usize {
        let values = self.values.iter().flatten().map(|column| 8 * column.len()).sum::<usize>();
        size_of::<Self>() + self.state.bytes().len() + self.checkpoint.bytes().len() + values
    }

    /// Steps taken in the episode; `None` before the first reset.
    pub fn step(&self) -> Option<u64> {
        self.progress.map(|progress| progress.episode.step)
    }
}

impl World {
    /// Saves a slot, so that its episode can go on from here again.
    ///
    /// # Errors
    ///
    /// No such slot; its environment cannot write its state down.
    pub fn save_slot(&self, slot: usize) -> Result<SavedSlot, WorldError> {
        self.check_slot("save_slot", slot)?;
        let mut state = EnvState::new();
        self.slots[slot].env.snapshot(&mut state).map_err(|source| self.env_error(slot, source))?;
        let row = self.infos.row(slot);
        let fields = self.infos.schema().fields()[..self.fields.of_policy()].iter().enumerate();
        let Slot { saved: checkpoint, progress, goal_image_is_given, .. } = &self.slots[slot];
        let is_kept = |field: &Field| !is_image(field) || (*goal_image_is_given && field.name == GOAL_IMAGE);
        let values = fields.map(|(index, field)| is_kept(field).then(|| row.at(index).to_column())).collect();
        Ok(SavedSlot { state, checkpoint: checkpoint.clone(), progress: *progress, values })
    }

    /// Goes back to what [`World::save_slot`] saved of this or of another world with the same environments and options.
    /// The same actions then give the same bits. A policy is not taken back: attach it anew where it remembers.
    ///
    /// # Errors
    ///
    /// No such slot; the state is of another environment; the infos have other columns.
    pub fn restore_slot(&mut self, slot: usize, saved: &SavedSlot) -> Result<(), WorldError> {
        self.check_slot("restore_slot", slot)?;
        let of_policy = self.fields.of_policy();
        if saved.values.len() != of_policy {
            let reason = "the infos have other columns than when the slot was saved".to_owned();
            return Err(WorldError::Option { option: "restore_slot", reason });
        }
        let restored = self.slots[slot].env.restore(&saved.state);
        restored.map_err(|source| self.env_error(slot, source))?;
        let Self { slots, infos, frames, .. } = self;
        let place = &mut slots[slot];
        let mut rows = infos.rows_mut();
        let out = rows.select(slot);
        place.env.write_episode(out);
        place.env.observe(out);
        if let (Some(frames), Some(progress)) = (frames, &saved.progress) {
            frames.show(progress.episode, &mut place.scratch, out);
        }
        for (index, values) in saved.values.iter().enumerate() {
            let fits = values.as_ref().is_none_or(|values| out.slice_mut(index).copy_from(values.as_slice()));
            if !fits {
                let reason = "a column has another type or shape than when the slot was saved".to_owned();
                return Err(WorldError::Option { option: "restore_slot", reason });
            }
        }
        for index in of_policy..out.schema().fields().len() {
            out.slice_mut(index).fill_missing();
        }
        let schema = out.schema();
        let goal = schema.index(GOAL_IMAGE).filter(|&index| is_image(&schema.fields()[index]));
        place.goal_image_is_given = goal.is_some_and(|index| saved.values[index].is_some());
        (place.progress, place.saved) = (saved.progress, saved.checkpoint.clone());
        place.next = None;
        Ok(())
    }

    fn check_slot(&self, option: &'static str, slot: usize) -> Result<(), WorldError> {
        if slot < self.slots.len() {
            return Ok(());
        }
        let reason = format!("there is no slot {slot}, only {}", self.slots.len());
        Err(WorldError::Option { option, reason })
    }

    fn env_error(&self, slot: usize, source: crate::error::EnvError) -> WorldError {
        let episode = self.slots[slot].progress.map_or(0, |progress| progress.episode.index);
        WorldError::Env { slot, episode, source }
    }
}

fn is_image(field: &Field) -> bool {
    field.dtype == Dtype::U8 && matches!(field.shape[..], [_, _, 1 | 3])
}
