//! The moment that plans start from.

use std::sync::Arc;

use swm_core::{RowView, View};

use super::actions::ActionMap;
use super::history::HistoryView;
use super::policy::Row;

/// What is known when plans are made: which environments need one, what they say, and what led here.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    pub(super) view: View<'a>,
    pub(super) rows: &'a [usize],
    pub(super) states: &'a [Row],
    pub(super) actions: &'a Arc<ActionMap>,
}

impl<'a> Moment<'a> {
    /// B: how many plans are wanted.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether no plan is wanted.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Environment `index` of `0..B`.
    pub fn row(&self, index: usize) -> RowView<'a> {
        self.view.row(self.rows[index]).expect("only live environments need a plan")
    }

    /// All environments, those that need no plan included.
    pub fn view(&self) -> View<'a> {
        self.view
    }

    /// The rows of [`Moment::view`] that need a plan: `[B]`, ascending.
    pub fn rows(&self) -> &'a [usize] {
        self.rows
    }

    /// The recent past of environment `index` of `0..B`; `None` if the policy keeps none (`history_len` 1).
    /// Young episodes have fewer frames than others: a cost that needs equal numbers groups by them.
    pub fn history(&self, index: usize) -> Option<HistoryView<'a>> {
        self.states[self.rows[index]].history.as_ref().map(|history| HistoryView { history })
    }

    /// How numbers of a plan become actions.
    pub fn actions(&self) -> &'a Arc<ActionMap> {
        self.actions
    }
}
