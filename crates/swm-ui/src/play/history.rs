//! Saved states of the running episode, to go back to.

use swm_core::SavedSlot;

/// Memory for the states of an episode. Above it, every second one goes.
const MAX_BYTES: usize = 48 << 20;

/// States in the order of their steps.
#[derive(Default)]
pub(super) struct History {
    states: Vec<SavedSlot>,
    bytes: usize,
}

impl History {
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Keeps a state, which is later than all that are kept.
    pub(super) fn push(&mut self, state: SavedSlot) {
        self.bytes += state.bytes();
        self.states.push(state);
        if self.bytes > MAX_BYTES {
            let mut index = 0;
            self.states.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.bytes = self.states.iter().map(SavedSlot::bytes).sum();
        }
    }

    /// The last state at `step` or before; those after it are forgotten.
    pub(super) fn back_to(&mut self, step: u64) -> Option<&SavedSlot> {
        let kept = self.states.partition_point(|state| state.step().is_some_and(|at| at <= step)).max(1);
        self.states.truncate(kept);
        self.bytes = self.states.iter().map(SavedSlot::bytes).sum();
        self.states.last()
    }
}
