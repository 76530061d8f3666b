//! Actions of a world's next step: taken from the caller or asked of the policy, checked, and copied into the infos.

use crate::batch::Slice;
use crate::error::WorldError;
use crate::policy::{Actions, Policy as _, View};
use crate::run::Cancel;

use super::World;

impl World {
    /// Takes the actions of the next step, checked.
    pub(super) fn take_actions(
        &mut self,
        actions: Slice<'_>,
        mask: Option<&[bool]>,
    ) -> Result<(), WorldError> {
        let expected = self.actions.as_slice();
        if actions.dtype() != expected.dtype() || actions.len() != expected.len() {
            let dim = self.spec.action.dim();
            let reason = format!(
                "actions must be {} values of {} ({} environments × {dim}), found {} of {}",
                expected.len(),
                expected.dtype(),
                self.slots.len(),
                actions.len(),
                actions.dtype(),
            );
            return Err(WorldError::Actions { reason });
        }
        assert!(self.actions.as_slice_mut().copy_from(actions), "checked above");
        self.check_actions(mask)
    }

    pub(super) fn act(&mut self, cancel: Option<&Cancel>) -> Result<(), WorldError> {
        let Self { policy, infos, spec, slots, policy_seed, threads, actions, report, .. } = self;
        let policy = policy.as_mut().ok_or(WorldError::NoPolicy)?;
        let fields = report.schema().fields().len();
        (0..fields).for_each(|index| report.column_mut(index).fill_missing());
        let view = View { infos, spec, slots, seed: *policy_seed, threads, cancel };
        let mut actions = Actions { space: &spec.action, column: actions, report };
        if policy.is_parallel() && slots.len() > 1 {
            threads.install(|| policy.act(&view, &mut actions))?;
        } else {
            policy.act(&view, &mut actions)?;
        }
        self.check_actions(None)?;
        self.copy_report();
        Ok(())
    }

    /// Copies what the policy reported of live slots into the infos.
    fn copy_report(&mut self) {
        let first = self.fields.of_policy();
        for index in 0..self.report.schema().fields().len() {
            let size = self.report.schema().dim(index);
            for slot in (0..self.slots.len()).filter(|&slot| self.slots[slot].is_live()) {
                let (_, rest) = self.infos.column_mut(first + index).split_at(slot * size);
                let said = self.report.column(index).range(slot * size, size);
                assert!(rest.split_at(size).0.copy_from(said), "one schema made both");
            }
        }
    }

    /// Refuses actions outside of the space, and copies the others into the infos.
    fn check_actions(&mut self, mask: Option<&[bool]>) -> Result<(), WorldError> {
        let dim = self.spec.action.dim();
        let actions = self.actions.as_slice();
        for (index, slot) in self.slots.iter().enumerate() {
            let live = slot.live_episode().filter(|_| mask.is_none_or(|mask| mask[index]));
            let Some(episode) = live else { continue };
            let action = actions.range(index * dim, dim);
            let refuse = |reason: String| {
                Err(WorldError::Action { slot: index, episode: episode.index, step: episode.step, reason })
            };
            if !action.is_finite() {
                return refuse(format!("the action {} is not finite", told(action, dim)));
            }
            if !self.spec.action.holds_integers(action) {
                let (low, high) = self.spec.action.bounds();
                let [low, high] = [low, high].map(|bound| list(bound.into_iter()));
                return refuse(format!("the action {} is not between {low} and {high}", told(action, dim)));
            }
            let (_, rest) = self.infos.column_mut(self.fields.action).split_at(index * dim);
            assert!(rest.split_at(dim).0.copy_from(action), "one schema made both");
        }
        Ok(())
    }
}

/// `[5, NaN]`: the values of an action.
fn told(action: Slice<'_>, dim: usize) -> String {
    list((0..dim).map(|index| action.as_f64(index).unwrap_or(f64::NAN)))
}

fn list(values: impl Iterator<Item = f64>) -> String {
    format!("[{}]", values.map(|value| value.to_string()).collect::<Vec<_>>().join(", "))
}
