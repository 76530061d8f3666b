//! The recent past of one episode: frames of chosen fields and the actions between them.

use swm_core::{Batch, Column, Row, Slice};

use super::actions::ActionMap;

/// A ring of the last steps of one episode. Frames are k steps apart, counted back from the present; an
/// episode that is younger than the history has fewer frames; none is made up.
#[derive(Debug)]
pub(crate) struct History {
    frames: usize,
    block: usize,
    dim: usize,
    steps: u64,
    fields: Vec<Column>,
    actions: Vec<f32>,
}

impl History {
    /// Room for `frames` frames, `block` steps apart, of the fields `indices` of `infos`, and actions of `dim` plan
    /// values.
    pub(crate) fn new(frames: usize, block: usize, dim: usize, infos: &Batch, indices: &[usize]) -> Self {
        let capacity = (frames - 1) * block + 1;
        let column = |&index: &usize| {
            let field = &infos.schema().fields()[index];
            Column::zeros(field.dtype, capacity * field.dim())
        };
        let fields = indices.iter().map(column).collect();
        Self { frames, block, dim, steps: 0, fields, actions: vec![0.0; capacity * dim] }
    }

    /// Forgets everything: a new episode begins.
    pub(crate) fn clear(&mut self) {
        self.steps = 0;
    }

    /// Stores the present observation.
    pub(crate) fn observe(&mut self, row: Row<'_>, indices: &[usize]) {
        self.steps += 1;
        let slot = self.slot(0);
        for (column, &index) in self.fields.iter_mut().zip(indices) {
            let values = row.at(index);
            let (_, rest) = column.as_slice_mut().split_at(slot * values.len());
            assert!(rest.split_at(values.len()).0.copy_from(values), "one schema made both");
        }
    }

    /// Stores the action taken from the present observation; `planned` are its values in the plan.
    pub(crate) fn acted(&mut self, planned: &[f32], map: &ActionMap) {
        let start = self.slot(0) * self.dim;
        map.executed(planned, &mut self.actions[start..][..self.dim]);
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
    history: &'a History,
}

impl<'a> HistoryView<'a> {
    pub(super) fn of(history: &'a History) -> Self {
        Self { history }
    }

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
        let dim = values.len() / ((history.frames - 1) * history.block + 1);
        let back = (self.frames() - 1 - frame) * history.block;
        values.range(history.slot(back) * dim, dim)
    }

    /// A: values of an action, in the units of plans.
    pub fn action_dim(&self) -> usize {
        self.history.dim
    }

    /// Action `index` of `0..(n - 1) × k`, oldest first: `[A]`, as carried out, in the units of plans (normalized, if
    /// they are; integers one-hot). Actions `i × k..(i + 1) × k` lead from frame `i` to frame `i + 1`.
    pub fn action(&self, index: usize) -> &'a [f32] {
        let history = self.history;
        let back = (self.frames() - 1) * history.block - index;
        &history.actions[history.slot(back) * history.dim..][..history.dim]
    }
}
