//! OGBench's mazes: a point and an ant that look for a place in a grid of walls. Source: `ogbench` 1.2.2.
//!
//! * `layout`: the grids, their tasks, and the way from cell to cell;
//! * `models`: the compiled models; `factors`: what varies;
//! * `env`, `rows`, `task_state`: the environment, its rows and its saved states;
//! * `expert`, `gait`: the policies.

mod env;
mod expert;
mod factors;
mod gait;
mod layout;
mod models;
mod rows;
mod settings;
mod state;

use swm_core::EnvEntry;

use env::MazeEnv;

/// What moves through the maze.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Body {
    /// A ball that an action moves by as much.
    Point,
    /// Four legs with eight motors.
    Ant,
}

impl Body {
    /// The file of its model.
    fn file(self) -> &'static str {
        match self {
            Body::Point => "point.xml",
            Body::Ant => "ant.xml",
        }
    }

    /// How near the goal counts as there, m.
    fn reach(self) -> f64 {
        match self {
            Body::Point => 1.0,
            Body::Ant => 0.5,
        }
    }
}

const POINT_ID: &str = "swm/OGBPointMaze-v0";
const ANT_ID: &str = "swm/OGBAntMaze-v0";

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
