//! The reference's weak policy: random pushes that stay near the block. It collects contact-rich data; it is no
//! expert.

use swm_core::policy::write_action;
use swm_core::{Actor, PolicyError, Slice, SliceMut, SlotView, Space};

use super::discrete;

/// Samples a target within 100 px of the agent and moves it to within `reach` px of the block, per axis.
pub(super) struct Weak {
    /// Largest distance of the target from the block's origin, per axis, in pixels.
    pub(super) reach_px: f64,
    /// Actions are offsets from the agent, rather than targets in pixels.
    pub(super) relative: bool,
}

impl Actor for Weak {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let agent: &[f64] = view.row.get("pos_agent")?;
        let block: &[f64] = view.row.get("block_pose")?;
        let mut stream = view.episode.seed.indexed("policy weak", [view.episode.step, 0]);
        let uniform = Space::uniform_box(swm_core::Dtype::F64, &[2], -1.0, 1.0).sample(&mut stream);
        let Slice::F64(sampled) = uniform.data.as_slice() else { unreachable!("a box of f64") };
        let offset = [0, 1].map(|axis| {
            let target = agent[axis] + 100.0 * sampled[axis];
            let near = target.clamp(block[axis] - self.reach_px, block[axis] + self.reach_px);
            ((near - agent[axis]) / 100.0).clamp(-1.0, 1.0) as f32
        });
        match &mut action {
            SliceMut::I64(bins) => bins.copy_from_slice(&discrete::from_continuous(offset)),
            _ if self.relative => write_action(&mut action, &offset),
            _ => write_action(&mut action, &[0, 1].map(|axis| agent[axis] as f32 + 100.0 * offset[axis])),
        }
        Ok(())
    }
}
