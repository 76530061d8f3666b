//! Uniformly random actions.

use crate::batch::SliceMut;
use crate::error::PolicyError;
use crate::policy::{Actor, PerEpisode, Policy, SlotView};

/// Samples every action uniformly from the action space.
pub fn random() -> impl Policy {
    PerEpisode::new("random", |_: &SlotView<'_>| Ok(Box::new(Random) as Box<dyn Actor>))
}

struct Random;

impl Actor for Random {
    fn act(&mut self, view: &SlotView<'_>, action: SliceMut<'_>) -> Result<(), PolicyError> {
        let mut rng = view.episode.seed.indexed("policy random", [view.episode.step, 0]);
        view.spec.action.sample_into(&mut rng, action);
        Ok(())
    }
}
