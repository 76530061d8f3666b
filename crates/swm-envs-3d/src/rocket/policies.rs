//! Policies of rocket landing: the expert, alone and with noise, and the planner's settings.

use swm_core::policies::NoisyExpert;
use swm_core::{PolicyContext, PolicyError, SlotView};

use super::flight::Conditions;
use super::guidance::Pilot;
use super::state::{ACTION_DIM, STATE_DIM, State};

/// A planner on the true dynamics that lands.
pub(super) const PLANNER: &str =
    "icem:samples=64,elites=8,iterations=3,horizon=16,receding_horizon=2,action_block=1,return_best=true";

/// The expert of one episode, which knows its factors.
pub(super) struct Expert {
    conditions: Conditions,
    pilot: Pilot,
}

impl NoisyExpert<ACTION_DIM> for Expert {
    const SUMMARY: &'static str = "descends as fast as the engine can brake, by throttle and gimbal";
    const STD: &'static str = "0.1";
    const STREAM: &'static str = "policy rocket noise";
    type Shared = ();

    fn shared(_: &PolicyContext<'_>) -> Result<(), PolicyError> {
        Ok(())
    }

    fn new(_: &(), view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let dry_mass: &[f64] = view.row.get("variation.rocket.dry_mass")?;
        let wind: &[f64] = view.row.get("variation.environment.wind")?;
        let conditions = Conditions { dry_mass: dry_mass[0], wind: [wind[0], wind[1]] };
        Ok(Self { conditions, pilot: Pilot::default() })
    }

    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; ACTION_DIM], PolicyError> {
        let row: &[f64] = view.row.get("state")?;
        let row: &[f64; STATE_DIM] = row.try_into().map_err(|_| PolicyError::Unsupported {
            policy: "expert".to_owned(),
            reason: format!("the column `state` has {} values, not {STATE_DIM}", row.len()),
        })?;
        Ok(self.pilot.act(&self.conditions, &State::from_row(row)))
    }
}
