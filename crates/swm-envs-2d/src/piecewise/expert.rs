//! The expert of Piecewise: walks straight to the target against the push of its zone, with noise if asked.

use swm_core::policies::NoisyExpert;
use swm_core::{PolicyContext, PolicyError, SlotView};
use swm_fov::{FactorEnv, FovSpace};

use super::env::Piecewise;
use super::settings::Settings;
use super::zones::Zones;

/// A planner on the true dynamics that finds the target.
pub(super) const PLANNER: &str =
    "icem:samples=32,elites=4,iterations=2,horizon=4,receding_horizon=1,action_block=2,return_best=true";

/// The expert in one episode.
pub(super) struct Expert {
    zones: Zones,
}

impl NoisyExpert<2> for Expert {
    const SUMMARY: &'static str = "walks straight to the target, against the push of its zone";
    const STD: &'static str = "1";
    type Shared = (FovSpace, usize);

    fn shared(context: &PolicyContext<'_>) -> Result<Self::Shared, PolicyError> {
        let settings: Settings = context.config.parse_settings(context.env.id)?;
        Ok((FactorEnv::<Piecewise>::factors(context.config)?, settings.grid_n))
    }

    fn new((space, grid_n): &Self::Shared, view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let (fov, _) = FactorEnv::<Piecewise>::episode(space, view)?;
        Ok(Self { zones: Zones::new(&fov, *grid_n) })
    }

    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; 2], PolicyError> {
        let [agent, target]: [&[f32]; 2] = [view.row.get("state")?, view.row.get("goal_state")?];
        let bias = self.zones.bias([agent[0], agent[1]]);
        Ok([0, 1].map(|axis| f64::from((target[axis] - agent[axis] - bias[axis]) / self.zones.speed)))
    }
}
