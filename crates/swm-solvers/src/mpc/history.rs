//! The recent past of one episode: frames of chosen fields and the actions between them.

use swm_core::{Batch, Column, Row, Slice};

use super::actions::ActionMap;

/// A ring of the last steps of one episode. Frames are k steps apart, counted back from the present; an
/// episode that is younger than the history wanted has fewer frames: none is invented.
#[derive(Debug)]
pub(super) struct History {
    frames: usize,
    block: usize,
    width: usize,
    steps: u64,
    fields: Vec<Column>,
    actions: Vec<f32>,
}

impl History {
    /// Room for `frames` frames, `block` steps apart, of the fields `indices` of `infos`, and actions of `width` plan
    /// numbers.
    pub(super) fn new(frames: usize, block: usize, width: usize, infos: &Batch, indices: &[usize]) -> Self {
        let capacity = (frames - 1) * block + 1;
        let column = |&index: &usize| {
            let field = &infos.schema().fields()[index];
            Column::zeros(field.dtype, capacity * field.width())
        };
        let fields = indices.iter().map(column).collect();
        Self { frames, block, width, steps: 0, fields, actions: vec![0.0; capacity * width] }
    }

    /// Forgets everything: a new episode begins.
    pub(super) fn clear(&mut self) {
        self.steps = 0;
    }

    /// Remembers the observation of the present moment.
    pub(super) fn observe(&mut self, row: Row<'_>, indices: &[usize]) {
        self.steps += 1;
        let slot = self.slot(0);
        for (column, &index) in self.fields.iter_mut().zip(indices) {
            let values = row.at(index);
            let (_, rest) = column.as_slice_mut().split_at(slot * values.len());
            assert!(rest.split_at(values.len()).0.copy_from(values), "one schema made both");
        }
    }

    /// Remembers the action taken from the present moment, which `planned` asked for.
    pub(super) fn acted(&mut self, planned: &[f32], map: &ActionMap) {
        let start = self.slot(0) * self.width;
        map.executed(planned, &mut self.actions[start..][..self.width]);
    }

    /// The position in the ring of the step `back` steps before the present.
    fn slot(&self, back: usize) -> usize {
        let capacity = (self.frames - 1) * self.block + 1;
        ((self.steps - 1) as usize - back) % capacity
    }
}

/// What a cost sees of an episode's recent past.
#[derive(Clone, Copy, Debug)]
pub struct HistoryView<'a> {
    pub(super) history: &'a History,
}

impl<'a> HistoryView<'a> {
    /// n: frames that the episode really has, the present one included; at most `history_len`.
    pub fn frames(&self) -> usize {
        let History { frames, block, steps, .. } = *self.history;
        frames.min((steps.saturating_sub(1) as usize) / block + 1)
    }

    /// Frame `frame` of `0..n`, oldest first, of the field at position `field` of
    /// [`crate::Cost::history_fields`].
    pub fn frame(&self, field: usize, frame: usize) -> Slice<'a> {
        let history = self.history;
        let values = history.fields[field].as_slice();
        let width = values.len() / ((history.frames - 1) * history.block + 1);
        let back = (self.frames() - 1 - frame) * history.block;
        values.range(history.slot(back) * width, width)
    }

    /// Action `index` of `0..(n - 1) × k`, oldest first: `[A]`, as carried out, in the units of plans (normalized, if
    /// they are; integers one-hot). Actions `i × k..(i + 1) × k` lead from frame `i` to frame `i + 1`.
    pub fn action(&self, index: usize) -> &'a [f32] {
        let history = self.history;
        let back = (self.frames() - 1) * history.block - index;
        &history.actions[history.slot(back) * history.width..][..history.width]
    }
}
