//! Where an episode begins and where it should end: placing arm, cubes and furniture.

use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use swm_core::EpisodeSeed;
use swm_core::seed::Stream;
use swm_fov::Fov;

use super::factors::{EFFECTOR, SIZE, START_POSITION, START_YAW, factor_values};
use super::furniture::Which;
use super::pose;
use super::robot::Effector;
use super::state::{Pursued, TaskState};
use super::table::Table;
use super::tasks::{Arrangement, tasks};
use crate::suite::uniform;
use swm_mujoco::MujocoError;
use swm_mujoco::Simulation;

/// How far things of a task stand off their places at the start, m.
const OFF: f64 = 0.01;

/// Puts the effector to its start, turned at random, and computes everything.
pub(super) fn place_arm(
    table: &Table,
    sim: &mut Simulation,
    fov: &Fov,
    stream: &mut Stream,
) -> Result<(), MujocoError> {
    let position = fov.vector(EFFECTOR);
    let yaw = uniform(stream, -std::f64::consts::PI, std::f64::consts::PI);
    table.robot.place(sim, Effector { position, yaw });
    sim.forward()
}

/// Starts an episode of data collection: everything by the factors, furniture at random. Computes everything.
pub(super) fn place_by_factors(
    table: &Table,
    sim: &mut Simulation,
    task_state: &mut TaskState,
    fov: &Fov,
) -> Result<(), MujocoError> {
    let mut stream = EpisodeSeed::new(task_state.seed as u64).stream("start");
    place_arm(table, sim, fov, &mut stream)?;
    let (places, yaws, sizes) =
        (factor_values(fov, START_POSITION), factor_values(fov, START_YAW), factor_values(fov, SIZE));
    for (index, place) in places.chunks_exact(2).enumerate() {
        table.set_cube(sim, index, [place[0], place[1], sizes[index]], pose::about_z(yaws[index]));
    }
    if let Some(furniture) = &table.furniture {
        for which in [Which::Drawer, Which::Window] {
            let [closed, open] = which.range();
            furniture.set_position(sim, which, uniform(&mut stream, closed.min(open), closed.max(open)));
            let [position, _] = furniture.position(sim, which);
            task_state.goal_slides[which as usize] = position;
            furniture.set_handle_target(sim.model_mut(), which, position);
        }
        task_state.buttons = [0, 1].map(|_| stream.random_range(0..2u8));
        task_state.goal_buttons = task_state.buttons;
    }
    sim.forward()
}

/// The task of an episode, and which cube has which place in it.
pub(super) struct Chosen {
    start: Arrangement,
    goal: Arrangement,
    order: Vec<usize>,
}

impl Chosen {
    /// The task `asked` for, or any.
    pub(super) fn new(
        table: &Table,
        asked: Option<usize>,
        permute: bool,
        task_state: &mut TaskState,
    ) -> Self {
        let mut stream = EpisodeSeed::new(task_state.seed as u64).stream("task");
        let number = asked.unwrap_or_else(|| stream.random_range(1..=5));
        let mut order: Vec<usize> = (0..table.kind.cubes()).collect();
        if permute {
            order.shuffle(&mut stream);
        }
        task_state.task = number as i64;
        let task = &tasks(table.kind)[number - 1];
        Self { start: task.start, goal: task.goal, order }
    }

    /// Says where everything belongs.
    pub(super) fn set_goals(
        &self,
        table: &Table,
        sim: &mut Simulation,
        task_state: &mut TaskState,
        fov: &Fov,
    ) {
        let sizes = factor_values(fov, SIZE);
        for (index, place) in self.order.iter().enumerate() {
            let spot = self.goal.cubes[*place];
            let [x, y] = spot.at;
            table.set_goal(sim, index, [x, y, spot.height(sizes[index])], pose::IDENTITY);
        }
        task_state.pursued = Pursued::Everything;
        task_state.goal_buttons = self.goal.buttons;
        task_state.goal_slides = [self.goal.drawer, self.goal.window];
        if let Some(furniture) = &table.furniture {
            furniture.set_handle_target(sim.model_mut(), Which::Drawer, self.goal.drawer);
            furniture.set_handle_target(sim.model_mut(), Which::Window, self.goal.window);
        }
    }

    /// Puts everything where it starts, a little off, and computes everything.
    pub(super) fn place(
        &self,
        table: &Table,
        sim: &mut Simulation,
        task_state: &mut TaskState,
        fov: &Fov,
    ) -> Result<(), MujocoError> {
        let mut stream = EpisodeSeed::new(task_state.seed as u64).stream("start");
        let sizes = factor_values(fov, SIZE);
        place_arm(table, sim, fov, &mut stream)?;
        for (index, place) in self.order.iter().enumerate() {
            let spot = self.start.cubes[*place];
            let [x, y] = spot.at.map(|at| at + uniform(&mut stream, -OFF, OFF));
            let yaw = uniform(&mut stream, 0.0, std::f64::consts::TAU);
            table.set_cube(sim, index, [x, y, spot.height(sizes[index])], pose::about_z(yaw));
        }
        task_state.buttons = self.start.buttons;
        if let Some(furniture) = &table.furniture {
            for (which, position) in [(Which::Drawer, self.start.drawer), (Which::Window, self.start.window)]
            {
                let [closed, open] = which.range();
                let off = position + uniform(&mut stream, -OFF, OFF);
                furniture.set_position(sim, which, off.clamp(closed.min(open), closed.max(open)));
            }
        }
        sim.forward()
    }
}

/// Puts everything where it belongs, at rest, with the arm at its own start, and computes everything.
pub(super) fn place_at_goal(
    table: &Table,
    sim: &mut Simulation,
    task_state: &mut TaskState,
    fov: &Fov,
) -> Result<(), MujocoError> {
    let mut stream = EpisodeSeed::new(task_state.seed as u64).stream("goal");
    place_arm(table, sim, fov, &mut stream)?;
    for index in 0..table.kind.cubes() {
        if [Pursued::Everything, Pursued::Cube(index as u8)].contains(&task_state.pursued) {
            let (position, rotation) = table.goal(sim, index);
            table.set_cube(sim, index, position, rotation);
        }
    }
    if let Some(furniture) = &table.furniture {
        for which in [Which::Drawer, Which::Window] {
            furniture.set_position(sim, which, task_state.goal_slides[which as usize]);
        }
        task_state.buttons = task_state.goal_buttons;
    }
    sim.forward()
}
