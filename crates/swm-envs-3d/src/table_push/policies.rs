//! Policies of TablePush3D: the expert, alone and with noise, and the planner's settings.

use swm_core::policies::NoisyExpert;
use swm_core::{PolicyContext, PolicyError, SlotView};
use swm_fov::{FactorEnv, FovSpace};

use super::env::TablePush;
use super::guidance::Pilot;
use super::physics::Conditions;
use super::state::{STATE_DIM, State};

/// A planner on the true dynamics that brings the object to the goal.
pub(super) const PLANNER: &str =
    "icem:samples=64,elites=8,iterations=3,horizon=12,receding_horizon=2,action_block=2,return_best=true";

/// The expert in one episode, whose factors it knows.
pub(super) struct Expert {
    conditions: Conditions,
    pilot: Pilot,
}

impl NoisyExpert<2> for Expert {
    const SUMMARY: &'static str = "goes around the object and pushes it to the goal";
    const STD: &'static str = "0.3";
    type Shared = FovSpace;

    fn shared(context: &PolicyContext<'_>) -> Result<FovSpace, PolicyError> {
        Ok(FactorEnv::<TablePush>::factors(context.config)?)
    }

    fn new(space: &FovSpace, view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let (fov, _) = FactorEnv::<TablePush>::episode(space, view)?;
        Ok(Self { conditions: Conditions::new(&fov), pilot: Pilot::default() })
    }

    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; 2], PolicyError> {
        let row = |column: &str| -> Result<State, PolicyError> {
            let values: &[f64] = view.row.get(column)?;
            let row: &[f64; STATE_DIM] = values.try_into().map_err(|_| PolicyError::Unsupported {
                policy: "expert".to_owned(),
                reason: format!("the column `{column}` has {} values, not {STATE_DIM}", values.len()),
            })?;
            Ok(State::from_row(row))
        };
        Ok(self.pilot.act(&self.conditions, &row("state")?, row("goal_state")?.object()))
    }
}
