//! The policies of Craftax-Classic: the expert, alone and with random actions in between.

use swm_core::policy::write_action;
use swm_core::{Actor, EnvState, PerEpisode, Policy, PolicyEntry, PolicyError, SliceMut, SlotView};
use swm_fov::SavedFov;

use super::expert::choose;
use super::state::State;
use crate::random_actions::{acts_at_random, description_and_share, noisy_expert};

/// A planner on the true dynamics that collects what is near.
pub(super) const PLANNER: &str =
    "categorical-cem:samples=128,elites=12,iterations=3,horizon=12,receding_horizon=4,action_block=1";

/// `expert`.
pub(super) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "goes through the achievements and knows the whole world", |_, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        Ok(make("expert".to_owned(), 0.0))
    });

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = noisy_expert(|_, args| {
    let (description, share) = description_and_share(args)?;
    Ok(make(description, share))
});

fn make(description: String, share: f64) -> Box<dyn Policy> {
    Box::new(PerEpisode::new(description, move |_: &SlotView<'_>| {
        Ok(Box::new(Expert { state: EnvState::new(), share }) as Box<dyn Actor>)
    }))
}

/// The expert in one episode.
struct Expert {
    state: EnvState,
    share: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        if acts_at_random(view, "policy expert noise", self.share, &mut action) {
            return Ok(());
        }
        view.snapshot(&mut self.state)?;
        let (_, game): (SavedFov, State) = self.state.load(&view.spec.id)?;
        write_action(&mut action, &[choose(&game) as f32]);
        Ok(())
    }
}
