//! OGBench's mazes: a point, an ant and a humanoid that look for a place in a grid of walls, and an ant that takes a ball there.
//! Source: `ogbench` 1.2.2.
//!
//! * `layout`: the grids, their tasks, and the way from cell to cell;
//! * `models`: the compiled models; `factors`: what varies;
//! * `env`, `start`, `rows`, `state`: the environment, its starts and goals, its rows and its saved states;
//! * `humanoid`: what the humanoid observes; `soccer`: what the ball adds;
//! * `expert`, `dribble`, `gait`: the policies.

mod dribble;
mod env;
mod expert;
mod factors;
mod gait;
mod humanoid;
mod layout;
mod models;
mod rows;
mod settings;
mod soccer;
mod start;
mod state;

use swm_core::EnvEntry;

use env::MazeEnv;
use swm_mujoco::assets::{FileSet, HUMANOID_MAZE, MAZES};

/// What moves through the maze.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Body {
    /// A ball that an action moves by as much.
    Point,
    /// Four legs with eight motors.
    Ant,
    /// Two legs and two arms with 21 motors.
    Humanoid,
    /// An ant, and a ball that it takes to the goal.
    AntSoccer,
}

impl Body {
    /// The file of its model.
    fn file(self) -> &'static str {
        match self {
            Body::Point => "point.xml",
            Body::Ant | Body::AntSoccer => "ant.xml",
            Body::Humanoid => "humanoid.xml",
        }
    }

    /// Materials of the discs that a teleporter leads from and to. The humanoid's file has none of its own for them, so that the
    /// reference has no such maze; two that it has serve here.
    fn teleporter_materials(self) -> [&'static str; 2] {
        if self == Body::Humanoid { ["decoration", "self_white"] } else { ["teleport_in", "teleport_out"] }
    }

    /// The published files that its model is made from.
    fn files(self) -> FileSet {
        if self == Body::Humanoid { HUMANOID_MAZE } else { MAZES }
    }

    /// How near the goal counts as there, m.
    fn reach(self) -> f64 {
        if self == Body::Point { 1.0 } else { 0.5 }
    }

    /// Whether a ball has to reach the goal.
    fn has_ball(self) -> bool {
        self == Body::AntSoccer
    }

    /// Control steps of random actions that a goal's posture comes from.
    fn settling(self) -> u64 {
        match self {
            Body::Point | Body::Ant => 5,
            Body::AntSoccer => 10,
            Body::Humanoid => 40,
        }
    }
}

const POINT_ID: &str = "swm/OGBPointMaze-v0";
const ANT_ID: &str = "swm/OGBAntMaze-v0";
const HUMANOID_ID: &str = "swm/OGBHumanoidMaze-v0";
const SOCCER_ID: &str = "swm/OGBAntSoccer-v0";

/// `swm/OGBPointMaze-v0`.
pub const OGB_POINT_MAZE: EnvEntry =
    EnvEntry::new(POINT_ID, "a ball in one of five mazes, moved by what an action says", |config| {
        Ok(Box::new(MazeEnv::new(POINT_ID, Body::Point, config)?))
    })
    .family(crate::ogbench::FAMILY)
    .success("within 1 m of the goal")
    .settings(settings::SETTINGS)
    .policies(expert::POINT_POLICIES);

/// `swm/OGBAntMaze-v0`.
pub const OGB_ANT_MAZE: EnvEntry =
    EnvEntry::new(ANT_ID, "an ant of four legs in one of five mazes; torques of eight joints", |config| {
        Ok(Box::new(MazeEnv::new(ANT_ID, Body::Ant, config)?))
    })
    .family(crate::ogbench::FAMILY)
    .success("the torso within 0.5 m of the goal")
    .settings(settings::SETTINGS)
    .policies(expert::ANT_POLICIES);

/// `swm/OGBHumanoidMaze-v0`.
pub const OGB_HUMANOID_MAZE: EnvEntry =
    EnvEntry::new(HUMANOID_ID, "a humanoid in one of five mazes; torques of 21 joints", |config| {
        Ok(Box::new(MazeEnv::new(HUMANOID_ID, Body::Humanoid, config)?))
    })
    .family(crate::ogbench::FAMILY)
    .success("the torso within 0.5 m of the goal")
    .settings(settings::SETTINGS);

/// `swm/OGBAntSoccer-v0`.
pub const OGB_ANT_SOCCER: EnvEntry =
    EnvEntry::new(SOCCER_ID, "an ant that takes a ball to a place; torques of eight joints", |config| {
        Ok(Box::new(MazeEnv::new(SOCCER_ID, Body::AntSoccer, config)?))
    })
    .family(crate::ogbench::FAMILY)
    .success("the ball within 0.5 m of the goal")
    .settings(settings::SOCCER)
    .policies(dribble::POLICIES);
