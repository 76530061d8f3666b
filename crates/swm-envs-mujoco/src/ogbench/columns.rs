//! The columns of a row: names, shapes and values in one place, visited once to declare them and at every step to write
//! them. Names are the reference's, with a dot where it has a slash.

use swm_core::{Dtype, Field, RowsMut};

use super::furniture::{Furniture, Which};
use super::pose;
use super::state::{Pursued, TaskState};
use super::table::Table;
use swm_mujoco::Simulation;

/// Takes columns one after the other.
pub(super) trait Sink {
    /// Real values.
    fn values(&mut self, name: impl FnOnce() -> String, shape: &[usize], values: &[f64]);
    /// Integers.
    fn integers(&mut self, name: impl FnOnce() -> String, shape: &[usize], values: &[i64]);
}

/// Collects the fields.
#[derive(Default)]
pub(super) struct Declare(pub(super) Vec<Field>);

impl Sink for Declare {
    fn values(&mut self, name: impl FnOnce() -> String, shape: &[usize], _: &[f64]) {
        self.0.push(Field::step(&name(), Dtype::F64, shape));
    }

    fn integers(&mut self, name: impl FnOnce() -> String, shape: &[usize], _: &[i64]) {
        self.0.push(Field::step(&name(), Dtype::I64, shape));
    }
}

/// Writes a row, from its first column on.
pub(super) struct Write<'a, 'b> {
    out: &'a mut RowsMut<'b>,
    next: usize,
}

impl<'a, 'b> Write<'a, 'b> {
    pub(super) fn new(out: &'a mut RowsMut<'b>) -> Self {
        Self { out, next: 0 }
    }
}

impl Sink for Write<'_, '_> {
    fn values(&mut self, _: impl FnOnce() -> String, _: &[usize], values: &[f64]) {
        self.out.write(self.next, values);
        self.next += 1;
    }

    fn integers(&mut self, _: impl FnOnce() -> String, _: &[usize], values: &[i64]) {
        self.out.write(self.next, values);
        self.next += 1;
    }
}

/// What lies in the middle of the observation's positions, m.
const CENTER: [f64; 3] = [0.425, 0.0, 0.0];

/// Appends the observation: arm, gripper, cubes, furniture, in the reference's order and scales.
pub(super) fn observation(table: &Table, sim: &Simulation, task_state: &TaskState, out: &mut Vec<f64>) {
    let scaled = |position: [f64; 3]| [0, 1, 2].map(|k| (position[k] - CENTER[k]) * 10.0);
    let robot = &table.robot;
    let effector = robot.effector(sim);
    out.extend(robot.angles(sim));
    out.extend(robot.velocities(sim));
    out.extend(scaled(effector.position));
    out.extend([effector.yaw.cos(), effector.yaw.sin()]);
    out.extend([robot.gripper_opening(sim) * 3.0, robot.gripper_contact(sim)]);
    for index in 0..table.kind.cubes() {
        let rotation = table.cube_rotation(sim, index);
        let yaw = pose::yaw(rotation);
        out.extend(scaled(table.cube(sim, index)));
        out.extend(rotation);
        out.extend([yaw.cos(), yaw.sin()]);
    }
    let Some(furniture) = &table.furniture else { return };
    for index in 0..2 {
        let [position, velocity] = furniture.button(sim, index);
        let is_free = f64::from(task_state.buttons[index]);
        out.extend([1.0 - is_free, is_free, position * 120.0, velocity]);
    }
    for (which, scale) in [(Which::Drawer, 18.0), (Which::Window, 15.0)] {
        let [position, velocity] = furniture.position(sim, which);
        out.extend([position * scale, velocity]);
    }
}

/// Visits the step columns, first the observation, whose values are `observed`.
pub(super) fn visit(
    table: &Table,
    sim: &Simulation,
    task_state: &TaskState,
    observed: &[f64],
    sink: &mut impl Sink,
) {
    let named = |name: &'static str| move || name.to_owned();
    let (qpos, qvel) = (sim.qpos(), sim.qvel());
    sink.values(named("observation"), &[observed.len()], observed);
    sink.values(named("qpos"), &[qpos.len()], qpos);
    sink.values(named("qvel"), &[qvel.len()], qvel);
    sink.values(named("control"), &[sim.ctrl().len()], sim.ctrl());
    sink.values(named("time"), &[], &[sim.time_s()]);
    sink.values(named("qacc_warmstart"), &[qvel.len()], sim.qacc_warmstart());
    sink.values(named("prev_qpos"), &[qpos.len()], &task_state.before_qpos);
    sink.values(named("prev_qvel"), &[qvel.len()], &task_state.before_qvel);
    let robot = &table.robot;
    let effector = robot.effector(sim);
    sink.values(named("proprio.joint_pos"), &[6], &robot.angles(sim));
    sink.values(named("proprio.joint_vel"), &[6], &robot.velocities(sim));
    sink.values(named("proprio.effector_pos"), &[3], &effector.position);
    sink.values(named("proprio.effector_yaw"), &[1], &[effector.yaw]);
    sink.values(named("proprio.gripper_opening"), &[1], &[robot.gripper_opening(sim)]);
    sink.values(named("proprio.gripper_vel"), &[1], &[robot.gripper_velocity(sim)]);
    sink.values(named("proprio.gripper_contact"), &[1], &[robot.gripper_contact(sim)]);
    for index in 0..table.kind.cubes() {
        let block = |what: &'static str| move || format!("privileged.block_{index}_{what}");
        let rotation = table.cube_rotation(sim, index);
        sink.values(block("pos"), &[3], &table.cube(sim, index));
        sink.values(block("quat"), &[4], &rotation);
        sink.values(block("yaw"), &[1], &[pose::yaw(rotation)]);
    }
    let count = table.kind.cubes();
    sink.values(named("mocap_pos"), &[count, 3], sim.mocap_pos());
    sink.values(named("mocap_quat"), &[count, 4], sim.mocap_quat());
    let next = table.next(sim, task_state);
    let target = if let Pursued::Cube(index) = next { usize::from(index) } else { 0 };
    let (position, rotation) = (table.next_place(sim, task_state, target), table.goal(sim, target).1);
    sink.integers(named("privileged.target_task"), &[], &[next.code()]);
    sink.integers(named("privileged.target_number"), &[], &[task_state.targets as i64]);
    sink.integers(named("privileged.target_block"), &[], &[target as i64]);
    sink.values(named("privileged.target_block_pos"), &[3], &position);
    sink.values(named("privileged.target_block_yaw"), &[1], &[pose::yaw(rotation)]);
    if let Some(furniture) = &table.furniture {
        // A drawer that has to be opened on the way is wanted open, wherever it should end.
        let on_the_way = table.has_to_open_drawer(sim, task_state).then(|| Which::Drawer.range()[1]);
        visit_furniture(furniture, sim, task_state, (next, on_the_way), sink);
    }
}

fn visit_furniture(
    furniture: &Furniture,
    sim: &Simulation,
    task_state: &TaskState,
    (next, drawer_on_the_way): (Pursued, Option<f64>),
    sink: &mut impl Sink,
) {
    for index in 0..2 {
        let button = |what: &'static str| move || format!("privileged.button_{index}_{what}");
        let [position, velocity] = furniture.button(sim, index);
        sink.integers(button("state"), &[], &[task_state.buttons[index].into()]);
        sink.values(button("pos"), &[1], &[position]);
        sink.values(button("vel"), &[1], &[velocity]);
    }
    for (which, name) in [(Which::Drawer, "drawer"), (Which::Window, "window")] {
        let slide = |what: &'static str| move || format!("privileged.{name}_{what}");
        let [position, velocity] = furniture.position(sim, which);
        let (handle, yaw) = furniture.handle(sim, which);
        sink.values(slide("pos"), &[1], &[position]);
        sink.values(slide("vel"), &[1], &[velocity]);
        sink.values(slide("handle_pos"), &[3], &handle);
        sink.values(slide("handle_yaw"), &[1], &[yaw]);
        let target = |what: &'static str| move || format!("privileged.target_{name}_{what}");
        let goal = task_state.goal_slides[which as usize];
        let now = drawer_on_the_way.filter(|_| which == Which::Drawer).unwrap_or(goal);
        let [x, y, z] = furniture.handle_target(sim, which);
        sink.values(target("pos"), &[1], &[now]);
        // The drawer opens along y.
        sink.values(target("handle_pos"), &[3], &[x, y + goal - now, z]);
    }
    let named = |name: &'static str| move || name.to_owned();
    let target = if let Pursued::Button(index) = next { usize::from(index) } else { 0 };
    // A button that stands between the goal and its slide is to be pressed, whatever state it should end in.
    let wanted = match task_state.pursued {
        Pursued::Everything if next == Pursued::Button(target as u8) => 1 - task_state.buttons[target],
        _ => task_state.goal_buttons[target],
    };
    sink.integers(named("privileged.target_button"), &[], &[target as i64]);
    sink.integers(named("privileged.target_button_state"), &[], &[wanted.into()]);
    sink.values(named("privileged.target_button_top_pos"), &[3], &furniture.button_top(sim, target));
    sink.integers(named("prev_button_states"), &[2], &task_state.before_buttons.map(i64::from));
    sink.integers(named("button_states"), &[2], &task_state.buttons.map(i64::from));
}
