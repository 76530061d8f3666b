//! The expert of SimpleNavigation: takes the shortest way through the maze, with random actions in between if asked.

use swm_core::{Actor, PerEpisode, Policy, PolicyEntry, PolicyError, SliceMut, SlotView};

use super::env::{FORWARD, LEFT, RIGHT};
use super::maze::{Distances, Maze};
use crate::random_actions::{acts_at_random, description_and_share, noisy_expert};

/// A planner on the true dynamics that finds the goal.
pub(super) const PLANNER: &str =
    "categorical-cem:samples=128,elites=12,iterations=3,horizon=10,receding_horizon=1,action_block=1";

/// `expert`.
pub(super) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "takes the shortest way through the maze to the goal", |_, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        Ok(make("expert".to_owned(), 0.0))
    });

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = noisy_expert(|_, args| {
    let (description, share) = description_and_share(args)?;
    Ok(make(description, share))
});

fn make(description: String, share: f64) -> Box<dyn Policy> {
    Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let (walls, goal): (&[u8], &[i64]) = (view.row.get("walls")?, view.row.get("goal_state")?);
        let maze = Maze::from_walls(walls);
        let maze = maze.map_err(|reason| PolicyError::Unsupported { policy: "expert".to_owned(), reason })?;
        Ok(Box::new(Expert { distances: maze.distances([goal[0], goal[1]]), share }) as Box<dyn Actor>)
    }))
}

/// The expert in one episode.
struct Expert {
    distances: Distances,
    share: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        if acts_at_random(view, "policy expert noise", self.share, &mut action) {
            return Ok(());
        }
        let state: &[i64] = view.row.get("state")?;
        let chosen = match self.distances.direction([state[0], state[1]]) {
            None => FORWARD,
            Some(direction) => [FORWARD, RIGHT, RIGHT, LEFT][(direction - state[2]).rem_euclid(4) as usize],
        };
        if let SliceMut::I64(values) = &mut action {
            values[0] = chosen;
        }
        Ok(())
    }
}
