//! The expert of SimplePointMaze: takes the shortest way around the walls, with noise if asked.

use swm_core::policies::NoisyExpert;
use swm_core::{PolicyContext, PolicyError, SlotView};
use swm_fov::{FactorEnv, FovSpace};

use super::env::SimplePointMaze;
use super::walls::{MAX_ACTION, Room};
use crate::shortest_path::ShortestPaths;

/// A planner on the true dynamics that finds the goal.
pub(super) const PLANNER: &str =
    "icem:samples=32,elites=4,iterations=2,horizon=6,receding_horizon=1,action_block=2,return_best=true";

/// The expert in one episode.
pub(super) struct Expert {
    room: Room,
    paths: ShortestPaths,
}

impl NoisyExpert<2> for Expert {
    const SUMMARY: &'static str = "takes the shortest way around the walls to the goal";
    const STD: &'static str = "0.1";
    type Shared = FovSpace;

    fn shared(context: &PolicyContext<'_>) -> Result<FovSpace, PolicyError> {
        Ok(FactorEnv::<SimplePointMaze>::factors(context.config)?)
    }

    fn new(space: &FovSpace, view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let (fov, state) = FactorEnv::<SimplePointMaze>::episode(space, view)?;
        let room = Room::new(&fov);
        Ok(Self { paths: room.shortest_paths(state.target), room })
    }

    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; 2], PolicyError> {
        let agent: &[f32] = view.row.get("state")?;
        let agent = [agent[0], agent[1]].map(f64::from);
        let to = self.paths.leg(agent).to;
        let wanted = [0, 1].map(|axis| (to[axis] - agent[axis]) / f64::from(self.room.speed));
        // Straight to the corner: along both axes by the same share of the way.
        let excess = wanted.iter().map(|value| value.abs() / f64::from(MAX_ACTION)).fold(1.0, f64::max);
        Ok(wanted.map(|value| value / excess))
    }
}
