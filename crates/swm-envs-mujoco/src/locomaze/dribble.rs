//! The weak policy of AntSoccer: an ant that gets behind the ball with one of its legs and pushes it along the shortest way to the
//! goal. Its constants were found by random search. It is slow, and helpless where the ball lies at a wall that it has to leave.

use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _, SliceMut,
    SlotView,
};

use super::Body;
use super::expert::{Arguments, Navigator, Progress, heading, pair, walk_noisily};
use super::gait::{PUSH, WALK, nearest_leg};
use super::layout::{Maze, cell_at, distance};
use super::settings::Settings;
use super::soccer::ball_place;

/// The policies of AntSoccer.
pub(super) const POLICIES: &[PolicyEntry] = &[PolicyEntry::new(
    "weak",
    "walks behind the ball and pushes it along the shortest way to the goal, with noise on its actions",
    make,
)
.settings(Arguments::SETTINGS)];

/// The pusher is a point of the leg that is ahead, so far from the middle of the ant, m.
const REACH: f64 = 0.518;
/// How far from the ball the pusher goes around it, m, and how strongly it returns to that distance.
const AROUND: f64 = 0.427;
const AROUND_RETURN: f64 = 2.681;
/// It pushes once it is this near to straight behind the ball, and until it is this far from it, rad.
const BEHIND: f64 = 0.223;
const ASIDE: f64 = 0.924;
/// How strongly it returns to the line on which the ball has to go: meters to the side per meter ahead and meter off.
const LINE_RETURN: f64 = 1.367;
/// Nearer than this the ant deals with the ball; farther away it walks to it, m.
const NEAR: f64 = 2.5;

fn make(context: &PolicyContext<'_>, args: &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError> {
    let noise = Arguments::noise(args)?;
    let maze = Settings::read(context.config, context.env.id, Body::AntSoccer)?.maze_type;
    let description = format!("{}:noise={noise}", args.name);
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let goal = pair(view, "goal_xy")?;
        let to_goal = Navigator::new(maze, goal);
        let progress = Progress::new(pair(view, "xy")?);
        Ok(Box::new(Dribbler { maze, goal, to_goal, noise, progress, pushes: false }) as Box<dyn Actor>)
    })))
}

/// The policy in one episode.
struct Dribbler {
    maze: Maze,
    goal: [f64; 2],
    /// The way of the ball.
    to_goal: Navigator,
    noise: f64,
    progress: Progress,
    /// Whether it was behind the ball and has not lost it since.
    pushes: bool,
}

impl Dribbler {
    /// Where to walk: rad in the world. `qpos` `[22]`.
    fn heading(&mut self, qpos: &[f64]) -> f64 {
        let ball = ball_place(qpos);
        let aim = if self.maze == Maze::Arena { self.goal } else { self.to_goal.aim(ball) };
        let leg = nearest_leg(qpos, heading(ball, aim));
        let pusher = [0, 1].map(|k| qpos[k] + REACH * leg[k]);
        let (offset, off) = ([0, 1].map(|k| pusher[k] - ball[k]), distance(pusher, ball));
        if off > NEAR {
            self.pushes = false;
            let direct = self.maze == Maze::Arena || cell_at(pusher) == cell_at(ball);
            return heading(pusher, if direct { ball } else { Navigator::new(self.maze, ball).aim(pusher) });
        }
        let ahead = [0, 1].map(|k| (aim[k] - ball[k]) / distance(ball, aim).max(f64::MIN_POSITIVE));
        // In the frame of the ball's way: how far ahead of the ball, and how far to the left of its line.
        let along = offset[0] * ahead[0] + offset[1] * ahead[1];
        let left = ahead[0] * offset[1] - ahead[1] * offset[0];
        self.pushes = left.atan2(-along).abs() < if self.pushes { ASIDE } else { BEHIND };
        let [x, y] = if self.pushes {
            let to_line = -LINE_RETURN * left;
            [ahead[0] - to_line * ahead[1], ahead[1] + to_line * ahead[0]]
        } else {
            let outwards = offset.map(|part| part / off.max(f64::MIN_POSITIVE));
            let turn = if left > 0.0 { 1.0 } else { -1.0 };
            let out = AROUND_RETURN * (AROUND - off);
            [out * outwards[0] - turn * outwards[1], out * outwards[1] + turn * outwards[0]]
        };
        y.atan2(x)
    }
}

impl Actor for Dribbler {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let heading = self.heading(view.row.get::<f64>("qpos")?);
        let heading = self.progress.detour(view, pair(view, "xy")?).unwrap_or(heading);
        let gait = if self.pushes { &PUSH } else { &WALK };
        walk_noisily(view, (gait, heading), self.noise, &mut action)
    }
}
