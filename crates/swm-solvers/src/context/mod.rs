//! What is known when plans are made, and how values of a plan become actions. No solver and no cost is known here.

mod actions;
mod history;
mod scale;

use std::sync::Arc;

use swm_core::{SlotView, View};

pub use actions::ActionMap;
pub(crate) use history::History;
pub use history::HistoryView;
pub use scale::ActionScale;

/// What is known when plans are made: which environments need one, their observations, and their recent past.
#[derive(Clone, Copy)]
pub struct PlanningContext<'a> {
    pub(crate) view: View<'a>,
    /// `[B]`: the slots that need a plan.
    pub(crate) slots: &'a [usize],
    /// `[N]`: the recent past of every slot.
    pub(crate) histories: &'a [Option<History>],
    pub(crate) actions: &'a Arc<ActionMap>,
}

impl<'a> PlanningContext<'a> {
    /// B: how many plans are needed.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether no plan is needed.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Environment `index` of `0..B`.
    pub fn env(&self, index: usize) -> SlotView<'a> {
        self.view.row(self.slots[index]).expect("only live environments need a plan")
    }

    /// All environments, those that need no plan included.
    pub fn view(&self) -> View<'a> {
        self.view
    }

    /// The slots of [`PlanningContext::view`] that need a plan: `[B]`, ascending.
    pub fn slots(&self) -> &'a [usize] {
        self.slots
    }

    /// The recent past of environment `index` of `0..B`; `None` if the policy keeps none (`history_len` 1).
    /// Young episodes have fewer frames than others: a cost that needs equally many groups environments by them.
    pub fn history(&self, index: usize) -> Option<HistoryView<'a>> {
        self.histories[self.slots[index]].as_ref().map(HistoryView::of)
    }

    /// The map from values of a plan to actions.
    pub fn actions(&self) -> &'a Arc<ActionMap> {
        self.actions
    }
}
