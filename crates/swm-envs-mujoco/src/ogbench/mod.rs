//! OGBench's manipulation environments: a UR5e arm with a gripper at a table with cubes, and one with furniture. Facts:
//! `ogbench` 1.2.2 and the reference's wrappers.
//!
//! * `compose`, `models`: the compiled models; `layout`, `tasks`: constants;
//! * `arm`, `robot`: inverse kinematics and the control law;
//! * `table`, `furniture`: where things are, and whether they are where they belong;
//! * `start`, `targets`: where episodes begin, and what is wanted;
//! * `env`, `columns`, `sim_state`, `task_state`: the environment, its rows and its saved states;
//! * `expert`: the policies.

mod arm;
mod columns;
mod compose;
mod env;
mod expert;
mod factors;
mod furniture;
mod layout;
mod models;
mod pose;
mod robot;
mod settings;
mod sim_state;
mod start;
mod state;
mod table;
mod targets;
mod tasks;

use swm_core::EnvEntry;

use env::TableEnv;

const CUBE_ID: &str = "swm/OGBCube-v0";
const SCENE_ID: &str = "swm/OGBScene-v0";

/// What `swm envs` lists OGBench's environments under.
pub(crate) const FAMILY: &str = "OGBench, on MuJoCo";

/// `swm/OGBCube-v0`.
pub const OGB_CUBE: EnvEntry = EnvEntry::new(
    CUBE_ID,
    "a robot arm that picks up one to four cubes and places them; effector and gripper commands",
    |config| Ok(Box::new(TableEnv::new(CUBE_ID, false, config)?)),
)
.family(FAMILY)
.success("every cube within 4 cm of its goal")
.settings(settings::CUBE_SETTINGS)
.policies(expert::POLICIES);

/// `swm/OGBScene-v0`.
pub const OGB_SCENE: EnvEntry = EnvEntry::new(
    SCENE_ID,
    "a robot arm with a cube, and a drawer and a window that buttons lock",
    |config| Ok(Box::new(TableEnv::new(SCENE_ID, true, config)?)),
)
.family(FAMILY)
.success("cube, drawer, window and buttons at their goals")
.settings(settings::SCENE_SETTINGS)
.policies(expert::POLICIES);
