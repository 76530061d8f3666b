//! Policies of classic control: the expert of each task, alone and with random actions in between.

use swm_core::policy::write_action;
use swm_core::{Actor, PerEpisode, Policy, PolicyContext, PolicyEntry, PolicyError, SliceMut, SlotView};
use swm_fov::FactorEnv;

use super::env::{ClassicControl, SIMULATOR_STATE_COLUMN};
use super::task::Task;
use crate::random_actions::{acts_at_random, description_and_share, noisy_expert};

/// The policies of one environment.
pub(super) const fn policies<T: Task>() -> &'static [PolicyEntry] {
    const {
        &[
            PolicyEntry::new(
                "expert",
                "the rule that solves the task under most factors",
                |context, args| {
                    args.parse_as::<swm_core::registry::NoArgs>()?;
                    make::<T>(context, "expert".to_owned(), 0.0)
                },
            ),
            noisy_expert(|context, args| {
                let (description, share) = description_and_share(args)?;
                make::<T>(context, description, share)
            }),
        ]
    }
}

fn make<T: Task>(
    context: &PolicyContext<'_>,
    description: String,
    share: f64,
) -> Result<Box<dyn Policy>, PolicyError> {
    let space = FactorEnv::<ClassicControl<T>>::factors(context.config)?;
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let (fov, _) = FactorEnv::<ClassicControl<T>>::episode(&space, view)?;
        Ok(Box::new(Expert { task: T::new(&fov), share }) as Box<dyn Actor>)
    })))
}

/// The expert of one episode, which knows its factors.
struct Expert<T> {
    task: T,
    share: f64,
}

impl<T: Task> Actor for Expert<T> {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        if acts_at_random(view, "policy classic noise", self.share, &mut action) {
            return Ok(());
        }
        let state: &[f64] = view.row.get(SIMULATOR_STATE_COLUMN)?;
        let state = T::State::try_from(state).map_err(|_| PolicyError::Unsupported {
            policy: "expert".to_owned(),
            reason: format!("the column `{SIMULATOR_STATE_COLUMN}` does not hold a state of {}", T::ID),
        })?;
        write_action(&mut action, &[self.task.act(&state)]);
        Ok(())
    }
}
