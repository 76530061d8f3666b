//! The expert: it pushes towards the mark, and against the puck's speed.

use swm_core::policy::write_action;
use swm_core::registry::NoArgs;
use swm_core::{Actor, PerEpisode, PolicyEntry, PolicyError, SlotView, SliceMut};

/// `expert`.
pub(crate) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "pushes towards the mark, and brakes in time", |_, args| {
        args.parse_as::<NoArgs>()?;
        Ok(Box::new(PerEpisode::new("expert".to_owned(), |_: &SlotView<'_>| {
            Ok(Box::new(Expert) as Box<dyn Actor>)
        })))
    });

struct Expert;

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let [state, goal]: [&[f64]; 2] = [view.row.get("state")?, view.row.get("goal_state")?];
        let push = |axis: usize| (6.0 * (goal[axis] - state[axis]) - 4.0 * state[2 + axis]).clamp(-1.0, 1.0);
        write_action(&mut action, &[push(0) as f32, push(1) as f32]);
        Ok(())
    }
}
