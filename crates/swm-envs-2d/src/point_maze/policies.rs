//! Policies that know the maze: `expert` goes the shortest way, `explorer` wanders from cell to cell.
//!
//! Both steer by the velocity that they want: along the way, as fast as the next bend allows.

use rand_distr::{Distribution as _, StandardUniform};
use swm_core::policies::{NoisyExpert, expert, noisy, noisy_expert};
use swm_core::{EpisodeSeed, PolicyContext, PolicyEntry, PolicyError, SlotView};

use super::factors::layout_at;
use super::layout::{Layout, center};
use super::physics::{Disc, STEP_S};
use super::shortest_path::shortest_paths;
use crate::shortest_path::{ShortestPaths, distance};

/// The policies of the maze.
pub(super) const POLICIES: &[PolicyEntry] = &[
    expert::<Navigator<false>, 2>(),
    noisy_expert::<Navigator<false>, 2>(),
    noisy::<Navigator<true>, 2>(
        "explorer",
        "wanders from one random cell to the next, whatever the goal, with noise on its actions \
                  (`explorer:STD`): diverse data, best with terminate_at_goal=false",
    ),
];

/// One episode's navigation: to the goal, or to random cells, one after the other.
struct Navigator<const EXPLORES: bool> {
    layout: &'static Layout,
    disc: Disc,
    /// A way ends within this distance of its goal.
    goal_radius: f64,
    paths: ShortestPaths,
    target: [f64; 2],
    /// Cells that the explorer has chosen so far.
    errands: u64,
}

/// Explorers choose the next cell within this distance of the middle of theirs.
const VISITED: f64 = 1.0;
/// Time in which the wanted velocity is to be reached, seconds.
const RESPONSE_S: f64 = 0.15;
/// Share of the greatest force that planned braking counts on.
const BRAKE: f64 = 0.6;
/// How far a bend may be overshot.
const BEND: f64 = 0.8;

impl<const EXPLORES: bool> Navigator<EXPLORES> {
    /// The force, in units of actions, that follows the way from here.
    fn steer(&self, position: [f64; 2], velocity: [f64; 2]) -> [f64; 2] {
        let Disc { mass, damping, gain, .. } = self.disc;
        let leg = self.paths.leg(position);
        let reach = distance(position, leg.to);
        if reach == 0.0 {
            return [0.0; 2];
        }
        // Braking is helped by the floor; driving is not.
        let brake = BRAKE * gain / mass;
        let speed_there = match leg.rest == 0.0 {
            // The goal must not be jumped over between two observations.
            true => 0.8 * self.goal_radius / STEP_S,
            false => (brake * BEND).sqrt(),
        };
        let speed = (speed_there * speed_there + 2.0 * brake * reach).sqrt().min(gain / (mass * damping));
        let force = [0, 1].map(|axis| {
            let wanted = speed * (leg.to[axis] - position[axis]) / reach;
            mass * ((wanted - velocity[axis]) / RESPONSE_S + damping * wanted) / gain
        });
        let scale = force[0].abs().max(force[1].abs()).max(1.0);
        force.map(|force| force / scale)
    }
}

impl<const EXPLORES: bool> NoisyExpert<2> for Navigator<EXPLORES> {
    const SUMMARY: &'static str = "takes the shortest way to the goal";
    const STD: &'static str = "0.5";
    const STREAM: &'static str = "policy maze noise";
    type Shared = ();

    fn shared(_: &PolicyContext<'_>) -> Result<(), PolicyError> {
        Ok(())
    }

    fn new((): &(), view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let number = |factor: &str| -> Result<f64, PolicyError> {
            let values: &[f64] = view.row.get(&format!("variation.{factor}"))?;
            Ok(values[0])
        };
        let index: &[i64] = view.row.get("variation.maze.layout")?;
        let layout = layout_at(index[0]).ok_or_else(|| PolicyError::Unsupported {
            policy: "expert".to_owned(),
            reason: format!("there is no layout {}", index[0]),
        })?;
        let disc = Disc {
            radius: number("agent.radius")?,
            mass: number("agent.mass")?,
            damping: number("agent.damping")?,
            gain: number("agent.gain")?,
        };
        let (target, goal_radius) = match EXPLORES {
            true => (random_cell(layout, view.episode.seed, 0), VISITED),
            false => {
                let goal: &[f64] = view.row.get("goal_state")?;
                ([goal[0], goal[1]], number("goal.radius")?)
            }
        };
        let paths = shortest_paths(layout, disc.radius, target);
        Ok(Self { layout, disc, goal_radius, paths, target, errands: 0 })
    }

    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; 2], PolicyError> {
        let state: &[f64] = view.row.get("state")?;
        let (position, velocity) = ([state[0], state[1]], [state[2], state[3]]);
        if EXPLORES && distance(position, self.target) < VISITED {
            self.errands += 1;
            self.target = random_cell(self.layout, view.episode.seed, self.errands);
            self.paths = shortest_paths(self.layout, self.disc.radius, self.target);
        }
        Ok(self.steer(position, velocity))
    }
}

/// The middle of the cell that an explorer goes to next.
fn random_cell(layout: &Layout, seed: EpisodeSeed, errand: u64) -> [f64; 2] {
    let share: f64 = StandardUniform.sample(&mut seed.indexed("policy maze cell", [errand, 0]));
    let count = layout.free_cells().count();
    let index = ((share * count as f64) as usize).min(count - 1);
    center(layout.free_cells().nth(index).unwrap_or([1, 1]))
}
