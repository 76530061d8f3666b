//! The experts of point and ant: a navigator that knows the shortest path, a body that follows it. Both read the row and the maze
//! of the settings.

use swm_core::env::VARIATION_PREFIX;
use swm_core::policy::write_action;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Setting, Settings as _,
    SliceMut, SlotView,
};

use super::Body;
use super::factors::SPEED;
use super::gait::{Gait, WALK, walk};
use super::layout::{Leg, Maze, cell_at, distance};
use super::settings::Settings;
use crate::suite::{normal, uniform};

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
    pub(super) struct Arguments {
        /// Standard deviation of the noise on each action; 0: none.
        noise: f64 = 0.1,
    }
}

const SETTINGS: &[Setting] = Arguments::SETTINGS;

impl Arguments {
    /// The noise of the actions, checked.
    pub(super) fn noise(args: &PolicyArgs) -> Result<f64, PolicyError> {
        let Self { noise } = args.parse_with("noise")?;
        args.check_not_negative("noise", noise)?;
        Ok(noise)
    }
}

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, body: Body) -> Result<Box<dyn Policy>, PolicyError> {
    let noise = Arguments::noise(args)?;
    let maze = Settings::read(context.config, context.env.id, body)?.maze_type;
    let description = format!("{}:noise={noise}", args.name);
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let goal = pair(view, "goal_xy")?;
        let expert = Expert {
            navigator: Navigator::new(maze, goal),
            body,
            noise,
            progress: Progress::new(pair(view, "xy")?),
        };
        Ok(Box::new(expert) as Box<dyn Actor>)
    })))
}

/// Two values of a row.
pub(super) fn pair(view: &SlotView<'_>, column: &str) -> Result<[f64; 2], PolicyError> {
    let values = view.row.get::<f64>(column)?;
    Ok([values[0], values[1]])
}

/// Knows the way.
pub(super) struct Navigator {
    maze: Maze,
    goal: [f64; 2],
    ways: Vec<Option<u32>>,
}

impl Navigator {
    /// How far ahead on the way one aims, m.
    const AHEAD: f64 = 1.0;

    pub(super) fn new(maze: Maze, goal: [f64; 2]) -> Self {
        Self { maze, goal, ways: maze.ways(cell_at(goal)) }
    }

    /// The place to go to from `place`: on the line from the middle of this cell to the next, so that corners are not cut; near
    /// the end the goal itself.
    pub(super) fn aim(&self, place: [f64; 2]) -> [f64; 2] {
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
    progress: Progress,
}

/// Whether a walker gets on, and where to where it does not.
pub(super) struct Progress {
    /// Where the body was at the step `anchored`.
    anchor: [f64; 2],
    anchored: u64,
    /// A direction, rad, to try until a step, where it did not get on.
    detour: Option<(f64, u64)>,
}

/// An ant that has not come this far, m, after so many steps is stuck, and tries another direction for so many.
const PROGRESS: f64 = 0.5;
const PATIENCE: u64 = 25;
const DETOUR: u64 = 12;

impl Progress {
    pub(super) fn new(anchor: [f64; 2]) -> Self {
        Self { anchor, anchored: 0, detour: None }
    }

    /// The direction to try, rad, of a walker at `place` that is stuck.
    pub(super) fn detour(&mut self, view: &SlotView<'_>, place: [f64; 2]) -> Option<f64> {
        let step = view.episode.step;
        if distance(place, self.anchor) > PROGRESS {
            (self.anchor, self.anchored) = (place, step);
        } else if step > self.anchored + PATIENCE {
            let mut stream = view.episode.seed.indexed("policy expert detour", [step, 0]);
            let turn = uniform(&mut stream, -std::f64::consts::PI, std::f64::consts::PI);
            self.detour = Some((turn, step + DETOUR));
            (self.anchor, self.anchored) = (place, step + DETOUR);
        }
        self.detour.filter(|&(_, end)| step < end).map(|(direction, _)| direction)
    }
}

/// The direction from one place to another, rad.
pub(super) fn heading(from: [f64; 2], to: [f64; 2]) -> f64 {
    (to[1] - from[1]).atan2(to[0] - from[0])
}

/// The ant's action that walks towards `heading_rad`, with noise.
pub(super) fn walk_noisily(
    view: &SlotView<'_>,
    (gait, heading_rad): (&Gait, f64),
    noise: f64,
    action: &mut SliceMut<'_>,
) -> Result<(), PolicyError> {
    let mut stream = view.episode.seed.indexed("policy expert step", [view.episode.step, 0]);
    let noise: [f64; 8] = std::array::from_fn(|_| noise * normal(&mut stream));
    let (qpos, qvel) = (view.row.get::<f64>("qpos")?, view.row.get::<f64>("qvel")?);
    let chosen = walk(gait, qpos, qvel, view.episode.step, heading_rad);
    write_action(action, &std::array::from_fn::<_, 8, _>(|k| limited(chosen[k] + noise[k])));
    Ok(())
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let place = pair(view, "xy")?;
        if self.body != Body::Point {
            let detour = self.progress.detour(view, place);
            let heading = detour.unwrap_or_else(|| heading(place, self.navigator.aim(place)));
            return walk_noisily(view, (&WALK, heading), self.noise, &mut action);
        }
        let mut stream = view.episode.seed.indexed("policy expert step", [view.episode.step, 0]);
        let noise: [f64; 2] = std::array::from_fn(|_| self.noise * normal(&mut stream));
        let aim = self.navigator.aim(place);
        // One step may be longer than what is left.
        let way = distance(place, aim).max(view.row.get::<f64>(&format!("{VARIATION_PREFIX}{SPEED}"))?[0]);
        write_action(&mut action, &[0, 1].map(|k| limited((aim[k] - place[k]) / way + noise[k])));
        Ok(())
    }
}

fn limited(value: f64) -> f32 {
    value.clamp(-1.0, 1.0) as f32
}
