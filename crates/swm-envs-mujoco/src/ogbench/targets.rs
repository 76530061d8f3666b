//! Sampling what is wanted next in data collection: OGBench's `set_new_target`.

use rand::RngExt as _;
use swm_core::EpisodeSeed;
use swm_core::seed::Stream;
use swm_fov::Fov;

use super::factors::{GOAL_POSITION, GOAL_YAW, SIZE, factor_values};
use super::furniture::Which;
use super::layout::HALF_SIZE;
use super::pose;
use super::state::{Pursued, TaskState};
use super::table::Table;
use crate::suite::uniform;
use swm_mujoco::Simulation;

/// Probability that a cube goes onto another one, where it can.
const STACK: f64 = 0.5;
/// Probability that a cube goes into an open drawer.
const PUT_AWAY: f64 = 0.3;
/// The middle of the open drawer, m.
const DRAWER: [f64; 3] = [0.33, -0.24, 0.066];
/// Where markers are that show nothing, m.
const ASIDE: [f64; 3] = [0.0, 0.0, -0.3];

/// Samples the next target. The first cube that is one goes to the goal of the factors; later goals are sampled.
pub(super) fn sample(table: &Table, sim: &mut Simulation, task_state: &mut TaskState, fov: &Fov) {
    let seed = EpisodeSeed::new(task_state.seed as u64);
    let mut stream = seed.indexed("target", [task_state.targets, 0]);
    task_state.targets += 1;
    task_state.pursued = choose(table, sim, task_state, &mut stream);
    match task_state.pursued {
        Pursued::Cube(_) | Pursued::Everything => sample_cube(table, sim, task_state, fov, &mut stream),
        Pursued::Button(index) => {
            let index = usize::from(index);
            task_state.goal_buttons[index] = 1 - task_state.buttons[index];
        }
        Pursued::Drawer => other_end(table, sim, task_state, Which::Drawer),
        Pursued::Window => other_end(table, sim, task_state, Which::Window),
    }
}

/// Shows where the cubes would go by the factors.
pub(super) fn show(table: &Table, sim: &mut Simulation, fov: &Fov) {
    for index in 0..table.kind.cubes() {
        let (position, yaw) = by_factors(fov, index);
        table.set_goal(sim, index, position, pose::about_z(yaw));
    }
}

/// The goal of a cube by the factors: m, and rad.
fn by_factors(fov: &Fov, index: usize) -> ([f64; 3], f64) {
    let all = factor_values(fov, GOAL_POSITION);
    (
        [all[2 * index], all[2 * index + 1], factor_values(fov, SIZE)[index]],
        factor_values(fov, GOAL_YAW)[index],
    )
}

/// What kind of target is next.
fn choose(table: &Table, sim: &Simulation, task_state: &TaskState, stream: &mut Stream) -> Pursued {
    let Some(furniture) = &table.furniture else { return Pursued::Cube(0) };
    let [x, y, z] = table.cube(sim, 0);
    let handle = furniture.handle(sim, Which::Drawer).0[1];
    let is_in_drawer = (0.21..=0.45).contains(&x)
        && (handle - 0.27..=handle - 0.07).contains(&y)
        && (0.0..=0.15).contains(&z);
    // The reference asks for locked slides too, at a quarter of the weight: nobody can do that.
    let slide = |index: usize| f64::from(task_state.buttons[index]);
    let weights = [if is_in_drawer { 0.0 } else { 1.0 }, 1.0, slide(0), slide(1)];
    let mut left = uniform(stream, 0.0, weights.iter().sum());
    let chosen = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    match chosen {
        Some(0) => Pursued::Cube(0),
        Some(2) => Pursued::Drawer,
        Some(3) => Pursued::Window,
        _ => Pursued::Button(stream.random_range(0..2u8)),
    }
}

/// A slide belongs at the end where it is not.
fn other_end(table: &Table, sim: &mut Simulation, task_state: &mut TaskState, which: Which) {
    let Some(furniture) = &table.furniture else { return };
    let [closed, open] = which.range();
    let [position, _] = furniture.position(sim, which);
    let is_open = (position - closed).abs() > (open - closed).abs() / 2.0;
    let goal = if is_open { closed } else { open };
    task_state.goal_slides[which as usize] = goal;
    furniture.set_handle_target(sim.model_mut(), which, goal);
}

fn sample_cube(
    table: &Table,
    sim: &mut Simulation,
    task_state: &mut TaskState,
    fov: &Fov,
    stream: &mut Stream,
) {
    let is_first = !std::mem::replace(&mut task_state.has_had_cube, true);
    let count = table.kind.cubes();
    let sizes = factor_values(fov, SIZE);
    let places: Vec<[f64; 3]> = (0..count).map(|index| table.cube(sim, index)).collect();
    let flat = |index: usize| [places[index][0], places[index][1]];
    let is_below = |index: usize, other: usize| {
        places[other][2] > places[index][2] && pose::distance(flat(index), flat(other)) < HALF_SIZE
    };
    let tops: Vec<usize> = (0..count).filter(|&i| !(0..count).any(|j| j != i && is_below(i, j))).collect();
    // The highest cube is always free.
    let target = tops[stream.random_range(0..tops.len())];
    task_state.pursued = Pursued::Cube(target as u8);
    let (position, yaw) = if is_first {
        by_factors(fov, target)
    } else {
        let others: Vec<usize> = tops.into_iter().filter(|&index| index != target).collect();
        let is_open = table.furniture.as_ref().is_some_and(|f| f.position(sim, Which::Drawer)[0] < -0.12);
        let position = if is_open && uniform(stream, 0.0, 1.0) < PUT_AWAY {
            let [x, y, z] = DRAWER;
            let off = [0, 1].map(|_| uniform(stream, -0.005, 0.005));
            [x + off[0], y + off[1], z - HALF_SIZE + sizes[target]]
        } else if !others.is_empty() && uniform(stream, 0.0, 1.0) < STACK {
            let below = others[stream.random_range(0..others.len())];
            let [x, y, z] = places[below];
            [x, y, z + sizes[below] + sizes[target]]
        } else {
            let [low, high] = table.kind.bounds().object;
            let [x, y] = [0, 1].map(|k| uniform(stream, low[k], high[k]));
            [x, y, sizes[target]]
        };
        (position, uniform(stream, 0.0, std::f64::consts::TAU))
    };
    for index in 0..count {
        table.set_goal(sim, index, ASIDE, pose::IDENTITY);
    }
    table.set_goal(sim, target, position, pose::about_z(yaw));
}
