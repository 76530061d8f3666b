//! How long plans are and how much of each is executed.

use super::report::Report;
use crate::error::PlanError;
use crate::ranges::check_length;
use crate::settings::Validate;

swm_core::settings! {
    /// Settings of [`crate::MpcPolicy`]; names and meanings are the reference's `PlanConfig`.
    ///
    /// The reference requires `horizon` and `receding_horizon` and defaults `action_block` to 1; its published runs use
    /// 5 blocks of 5 actions, all executed, with one frame of history. These are the defaults here.
    pub struct PlanConfig {
        /// Blocks per plan.
        ///
        /// H; a plan spans H × `action_block` environment steps.
        horizon: usize = 5,
        /// Blocks executed before replanning (at most horizon).
        receding_horizon: usize = 5,
        /// Plan only as far as the last full plan reached, until all of that is executed.
        ///
        /// After R of H blocks the next plan has H - R. For costs that ask for the goal at the end of a plan: a plan that is
        /// cut short at a full horizon has not begun to approach it.
        shrinking_horizon: bool = false,
        /// Frames that a model is shown, the present one included, `action_block` steps apart.
        history_len: usize = 1,
        /// Consecutive, different actions per block.
        action_block: usize = 5,
        /// Start from the unexecuted rest of the last plan; zeros follow.
        warm_start: bool = true,
        /// Clip actions to the action space. The reference does not.
        clip_actions: bool = true,
        /// Columns about the plans: off, plan, or timed.
        report: Report = Report::Off => "off",
    }
}

impl Validate for PlanConfig {
    fn validate(&self) -> Result<(), PlanError> {
        for (name, value) in [
            ("horizon", self.horizon),
            ("receding_horizon", self.receding_horizon),
            ("history_len", self.history_len),
            ("action_block", self.action_block),
        ] {
            check_length(name, value)?;
        }
        if self.receding_horizon > self.horizon {
            let reason = format!(
                "{} blocks of a plan of {} cannot be executed; lower it or raise horizon",
                self.receding_horizon, self.horizon
            );
            return Err(PlanError::setting("receding_horizon", reason));
        }
        Ok(())
    }
}
