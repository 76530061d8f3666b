//! The experts: a navigator that knows the shortest path, a body that follows it. Both read the row and the maze of the settings.

use swm_core::env::VARIATION_PREFIX;
use swm_core::policy::write_action;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
    SliceMut, SlotView,
};

use super::Body;
use super::factors::SPEED;
use super::gait::walk;
use super::layout::{Leg, Maze, cell_at, distance};
use super::settings::{SETTINGS as ENV_SETTINGS, Settings};
use crate::suite::{normal, uniform};
use crate::views::settings;

/// The policies of the point's mazes.
pub(super) const POINT_POLICIES: &[PolicyEntry] = &[PolicyEntry::new(
    "expert",
    "follows the shortest way over the middles of cells, with noise on its actions",
    |context, args| make(context, args, Body::Point),
)
.settings(SETTINGS)];

/// The policies of the ant's mazes.
pub(super) const ANT_POLICIES: &[PolicyEntry] = &[PolicyEntry::new(
    "expert",
    "walks the shortest way over the middles of cells in a trot, with noise on its actions",
    |context, args| make(context, args, Body::Ant),
)
.settings(SETTINGS)];

swm_core::settings! {
    /// Arguments of the policies. Unknown names are refused.
    struct Arguments {
        /// Standard deviation of the noise on each action; 0: none.
        noise: f64 = 0.1,
    }
}

const SETTINGS: &[Setting] = Arguments::SETTINGS;

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, body: Body) -> Result<Box<dyn Policy>, PolicyError> {
    let Arguments { noise } = args.parse_with("noise")?;
    args.check_not_negative("noise", noise)?;
    let settings: Settings = settings::read(context.config, context.env.id, ENV_SETTINGS)?;
    let maze = settings.maze_type;
    let description = format!("{}:noise={noise}", args.name);
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let goal = pair(view, "goal_xy")?;
        let navigator = Navigator { maze, goal, ways: maze.ways(cell_at(goal)) };
        let expert = Expert { navigator, body, noise, anchor: pair(view, "xy")?, anchored: 0, detour: None };
        Ok(Box::new(expert) as Box<dyn Actor>)
    })))
}

fn pair(view: &SlotView<'_>, column: &str) -> Result<[f64; 2], PolicyError> {
    let values = view.row.get::<f64>(column)?;
    Ok([values[0], values[1]])
}

/// Knows the way.
struct Navigator {
    maze: Maze,
    goal: [f64; 2],
    ways: Vec<Option<u32>>,
}

impl Navigator {
    /// How far ahead on the way one aims, m.
    const AHEAD: f64 = 1.0;

    /// The place to go to from `place`: on the line from the middle of this cell to the next, so that corners are not cut; near
    /// the end the goal itself.
    fn aim(&self, place: [f64; 2]) -> [f64; 2] {
        let Some(Leg { nearest, to, .. }) = self.maze.leg(&self.ways, place, self.goal) else {
            return self.goal;
        };
        let part = (Self::AHEAD / distance(nearest, to).max(f64::MIN_POSITIVE)).min(1.0);
        [0, 1].map(|k| nearest[k] + part * (to[k] - nearest[k]))
    }
}

/// The expert in one episode.
struct Expert {
    navigator: Navigator,
    body: Body,
    noise: f64,
    /// Where the body was at the step `anchored`, to see whether it gets on.
    anchor: [f64; 2],
    anchored: u64,
    /// A direction, rad, to try until a step, where it did not.
    detour: Option<(f64, u64)>,
}

/// An ant that has not come this far, m, after so many steps is stuck, and tries another direction for so many.
const PROGRESS: f64 = 0.5;
const PATIENCE: u64 = 25;
const DETOUR: u64 = 12;

impl Expert {
    fn heading(&mut self, view: &SlotView<'_>, place: [f64; 2]) -> f64 {
        let step = view.episode.step;
        if distance(place, self.anchor) > PROGRESS {
            (self.anchor, self.anchored) = (place, step);
        } else if step > self.anchored + PATIENCE {
            let mut stream = view.episode.seed.indexed("policy expert detour", [step, 0]);
            let turn = uniform(&mut stream, -std::f64::consts::PI, std::f64::consts::PI);
            self.detour = Some((turn, step + DETOUR));
            (self.anchor, self.anchored) = (place, step + DETOUR);
        }
        match self.detour {
            Some((direction, end)) if step < end => direction,
            _ => {
                let aim = self.navigator.aim(place);
                (aim[1] - place[1]).atan2(aim[0] - place[0])
            }
        }
    }
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let place = pair(view, "xy")?;
        let mut stream = view.episode.seed.indexed("policy expert step", [view.episode.step, 0]);
        let mut noise =
            |count: usize| -> Vec<f64> { (0..count).map(|_| self.noise * normal(&mut stream)).collect() };
        match self.body {
            Body::Point => {
                let (noise, aim) = (noise(2), self.navigator.aim(place));
                // One step may be longer than what is left.
                let way =
                    distance(place, aim).max(view.row.get::<f64>(&format!("{VARIATION_PREFIX}{SPEED}"))?[0]);
                write_action(&mut action, &[0, 1].map(|k| limited((aim[k] - place[k]) / way + noise[k])));
            }
            Body::Ant => {
                let (noise, heading) = (noise(8), self.heading(view, place));
                let (qpos, qvel) = (view.row.get::<f64>("qpos")?, view.row.get::<f64>("qvel")?);
                let chosen = walk(qpos, qvel, view.episode.step, heading);
                write_action(&mut action, &std::array::from_fn::<_, 8, _>(|k| limited(chosen[k] + noise[k])));
            }
        }
        Ok(())
    }
}

fn limited(value: f64) -> f32 {
    value.clamp(-1.0, 1.0) as f32
}
