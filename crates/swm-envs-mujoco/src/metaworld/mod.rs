//! Meta-World: a Sawyer arm and the ten tasks of MT10. Facts: metaworld 3.1.1, whose rewards are those of version 2.
//!
//! * `task`, `table`: what a task is, and the ten, one row each;
//! * `models`: the compiled models; `robot`: the drive to the start, control steps, observations;
//! * `reward`: rewards and their parts; `factors`: what varies;
//! * `env`, `rows`: the environment, its rows and its saved states;
//! * `expert`: the policies.

mod env;
mod expert;
mod factors;
mod models;
mod reward;
mod robot;
mod rows;
mod settings;
mod table;
mod task;

use swm_core::EnvEntry;

use env::MetaWorldEnv;
use task::Task;

/// Declares the environments: a constant, the name of the task in the package, what it is, what success is.
macro_rules! tasks {
    ($($name:ident, $alias:literal, $summary:literal, $success:literal;)*) => {
        $(
            #[doc = concat!("`swm/MetaWorld…-v0`, the task `", $alias, "`.")]
            pub const $name: EnvEntry =
                EnvEntry::new(table::$name.id, concat!("a Sawyer arm that ", $summary), |config| {
                    Ok(Box::new(MetaWorldEnv::new(&table::$name, config)?))
                })
                .aliases(&[concat!("swm/MetaWorld-", $alias, "-v0")])
                .family("Meta-World, on MuJoCo")
                .success($success)
                .settings(settings::SETTINGS)
                .policies(expert::POLICIES)
                .planner(PLANNER);
        )*
        /// All of them.
        const TASKS: &[&Task] = &[$(&table::$name),*];
    };
}

tasks! {
    REACH, "reach", "moves its fingers to a place in the air", "less than 0.05 m from the goal";
    PUSH, "push", "pushes a puck to a place on the table", "less than 0.05 m from the goal";
    PICK_PLACE, "pick-place", "picks up a puck and holds it at a place", "less than 0.07 m from the goal";
    DOOR_OPEN, "door-open", "opens the door of a safe", "the handle within 0.08 m of the goal along x";
    DRAWER_OPEN, "drawer-open", "opens a drawer", "the handle within 0.03 m of the goal";
    DRAWER_CLOSE, "drawer-close", "closes a drawer", "the handle within 0.065 m of the goal";
    BUTTON_PRESS_TOPDOWN, "button-press-topdown", "presses a button from above",
        "the button within 0.024 m of its end along z";
    PEG_INSERT_SIDE, "peg-insert-side", "puts a peg into a hole in the side of a block",
        "the head of the peg within 0.07 m of the goal, y and z counted double";
    WINDOW_OPEN, "window-open", "opens a window", "the handle within 0.05 m of the goal along x";
    WINDOW_CLOSE, "window-close", "closes a window", "the handle within 0.05 m of the goal along x";
}

/// A planner on the true dynamics.
const PLANNER: &str =
    "icem:samples=32,elites=5,iterations=2,horizon=6,receding_horizon=1,action_block=4,return_best=true";

/// The task of one of the ids.
fn task(id: &str) -> &'static Task {
    let found = TASKS.iter().find(|task| task.id == id);
    found.expect("policies of Meta-World belong to its environments")
}
