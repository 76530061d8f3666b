//! Fetch: a robot arm that reaches, pushes, slides, and picks and places at a table. Facts: gymnasium-robotics 1.4.2 and
//! the reference's wrappers.
//!
//! * `task`: constants of the four tasks; `models`: the compiled models and where episodes start;
//! * `robot`: control steps and observations; `factors`: what varies;
//! * `env`, `rows`: the environment, its rows and its saved states;
//! * `expert`, `strike`: the policies.

mod env;
mod expert;
mod factors;
mod models;
mod robot;
mod rows;
mod settings;
mod strike;
mod task;

use swm_core::{EnvEntry, PolicyEntry};

use env::FetchEnv;
use task::{Form, Reward, Task, Variant};

/// Declares the environments of a task: an entry and a variant for each id.
macro_rules! fetch {
    ($($task:ident, $name:literal, $summary:literal, $policies:expr, $planner:expr,
       $sparse:ident, $dense:ident, $dict:ident;)*) => {
        $(
            #[doc = concat!("`swm/Fetch", $name, "-v3`.")]
            pub const $sparse: EnvEntry = entry!($name, "", $summary, "", Sparse, Flat, $task, $policies, $planner);
            #[doc = concat!("`swm/Fetch", $name, "Dense-v3`.")]
            pub const $dense: EnvEntry = entry!(
                $name, "Dense", $summary, "; rewarded by distance", Dense, Flat, $task, $policies, $planner
            );
            #[doc = concat!("`swm/Fetch", $name, "Dict-v3`.")]
            pub const $dict: EnvEntry = entry!(
                $name, "Dict", $summary, "; the observation without the goal", Sparse, Parts, $task, $policies, $planner
            );
        )*
        /// All of them.
        const VARIANTS: &[Variant] = &[$(
            variant!($name, "", Sparse, Flat, $task),
            variant!($name, "Dense", Dense, Flat, $task),
            variant!($name, "Dict", Sparse, Parts, $task),
        )*];
    };
}

macro_rules! variant {
    ($name:literal, $suffix:literal, $reward:ident, $form:ident, $task:ident) => {
        Variant {
            id: concat!("swm/Fetch", $name, $suffix, "-v3"),
            task: Task::$task,
            reward: Reward::$reward,
            form: Form::$form,
        }
    };
}

macro_rules! entry {
    ($name:literal, $suffix:literal, $summary:literal, $more:literal, $reward:ident, $form:ident, $task:ident,
     $policies:expr, $planner:expr) => {
        EnvEntry::new(concat!("swm/Fetch", $name, $suffix, "-v3"), concat!($summary, $more), |config| {
            Ok(Box::new(FetchEnv::new(variant!($name, $suffix, $reward, $form, $task), config)?))
        })
        .family("Fetch robot, on MuJoCo")
        .success("less than 0.05 m from the goal")
        .settings(settings::SETTINGS)
        .policies($policies)
        .planner($planner)
    };
}

const POLICIES: &[PolicyEntry] = expert::POLICIES;
const SLIDE: &[PolicyEntry] = expert::SLIDE_POLICIES;

fetch! {
    Reach, "Reach", "a Fetch arm that moves its gripper to a place in the air", POLICIES, REACH_PLANNER,
        FETCH_REACH, FETCH_REACH_DENSE, FETCH_REACH_DICT;
    Push, "Push", "a Fetch arm that pushes a block to a place on the table", POLICIES, PLANNER,
        FETCH_PUSH, FETCH_PUSH_DENSE, FETCH_PUSH_DICT;
    Slide, "Slide", "a Fetch arm that strikes a puck so that it slides to a place out of reach", SLIDE, PLANNER,
        FETCH_SLIDE, FETCH_SLIDE_DENSE, FETCH_SLIDE_DICT;
    PickAndPlace, "PickAndPlace", "a Fetch arm that picks up a block and holds it at a place", POLICIES, PLANNER,
        FETCH_PICK_AND_PLACE, FETCH_PICK_AND_PLACE_DENSE, FETCH_PICK_AND_PLACE_DICT;
}

/// A planner that reaches.
const REACH_PLANNER: &str =
    "icem:samples=24,elites=4,iterations=2,horizon=4,receding_horizon=1,action_block=1,return_best=true";
/// A planner that pushes.
const PLANNER: &str =
    "icem:samples=48,elites=6,iterations=3,horizon=6,receding_horizon=1,action_block=2,return_best=true";

/// The variant of one of the ids.
fn variant(id: &str) -> &'static Variant {
    let found = VARIANTS.iter().find(|variant| variant.id == id);
    found.expect("policies of Fetch belong to its environments")
}
