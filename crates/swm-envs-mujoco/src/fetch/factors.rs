//! The factors of variation, and what each does to the model. Those of starts and goals are read when an episode begins.

use swm_core::{Dtype, Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::task::{CLEARANCE, Task};
use crate::suite::{Control, Effect};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// The camera that images are rendered from: where the reference's free camera is.
pub(super) const VIEW: &str = "view";
/// The color of floor and sky.
pub(super) const BACKGROUND: &str = "background.color";
/// Where the gripper starts.
pub(super) const GRIPPER: &str = "agent.start_position";
/// Where the object starts.
pub(super) const OBJECT: &str = "block.start_position";
/// How the object is turned at the start.
pub(super) const ANGLE: &str = "block.angle";
/// What the object weighs.
pub(super) const MASS: &str = "block.mass";
/// Where the goal is.
pub(super) const GOAL: &str = "goal.start_position";
/// Whether the goal's height is that of [`GOAL`], or that of the table.
pub(super) const IN_THE_AIR: &str = "goal.in_the_air";

/// The factors of a task with what they do, in the order of their columns.
pub(super) fn controls(task: Task) -> Vec<Control> {
    let mut controls =
        vec![color("table.color", [0.3; 3], "color of the table", Effect::Material("table_mat"))];
    if task.has_object() {
        let material = if task == Task::Slide { "puck_mat" } else { "block_mat" };
        let doc = "color of the block or puck";
        controls.push(color("object.color", [0.8, 0.1, 0.1], doc, Effect::Material(material)));
    }
    // The sky is a texture, which only images have: see `env`.
    let floor = Effect::Material("floor_mat");
    controls.push(color(BACKGROUND, [0.1; 3], "color of floor and sky", floor));
    controls.push(Control {
        factor: boxed("light.intensity", [&[0.0], &[1.0]], &[0.7], "diffuse brightness of the light")
            .sampled_by_default(),
        effect: Effect::Light("light0"),
    });
    controls.push(camera());
    controls.push(transparent_arm());
    let start = |factor: Factor| Control { factor, effect: Effect::Start };
    controls.push(start(gripper(task)));
    if task.has_object() {
        controls.push(start(object(task)));
        let pi = std::f64::consts::PI;
        let doc = "turn of the block or puck about the vertical at the start, rad";
        controls.push(start(boxed(ANGLE, [&[-pi], &[pi]], &[0.0], doc)));
        controls.push(mass());
    }
    controls.push(start(goal(task)));
    if task == Task::PickAndPlace {
        let doc = "1: the goal is as high as `goal.start_position` says, 0: on the table";
        let in_the_air = Factor::integer(IN_THE_AIR, 0, 1, 0).doc(doc).sampled_by_default();
        controls.push(start(in_the_air.shows_with(GOAL, vec![1.3, 0.74, 0.6])));
    }
    controls
}

/// The space of these factors.
pub(super) fn space(task: Task, controls: &[Control]) -> FovSpace {
    let space = FovSpace::new(controls.iter().map(|control| control.factor.clone()).collect());
    if !task.has_object() {
        return space;
    }
    space.with_constraints(vec![Constraint {
        owner: OBJECT,
        reads: &[GRIPPER],
        words: "at least 0.1 m from the gripper",
        holds: |fov| {
            let ([x, y], [a, b]) = (pair(fov, OBJECT), pair(fov, GRIPPER));
            (x - a).hypot(y - b) >= CLEARANCE
        },
    }])
}

/// The values of a factor.
pub(super) fn values<const N: usize>(fov: &Fov, name: &str) -> [f64; N] {
    let values = fov.value(name).to_f64s(name).expect("factors are numbers");
    std::array::from_fn(|k| values[k])
}

/// The two values of a factor.
pub(super) fn pair(fov: &Fov, name: &str) -> [f64; 2] {
    values(fov, name)
}

fn boxed(name: &str, [low, high]: [&[f64]; 2], default: &[f64], doc: &str) -> Factor {
    let shape = vec![default.len()];
    let space = Space::Box { dtype: Dtype::F64, shape, low: low.to_vec(), high: high.to_vec() };
    Factor::new(name, space, Value::vector(default)).doc(doc)
}

fn color(name: &str, default: [f64; 3], doc: &str, effect: Effect) -> Control {
    let factor = boxed(name, [&[0.0; 3], &[1.0; 3]], &default, doc).sampled_by_default();
    Control { factor, effect }
}

/// The free camera of the reference: how far away, what it looks at, and from where, in m and degrees.
const DISTANCE: f64 = 2.5;
const LOOK_AT: [f64; 3] = [1.3, 0.75, 0.55];
const AZIMUTH: f64 = 132.0;
const ELEVATION: f64 = -14.0;

/// Place, and x and y axes, of the camera with azimuth and elevation changed by so many degrees.
pub(super) fn view([azimuth, elevation]: [f64; 2]) -> ([f64; 3], [f64; 6]) {
    let (sin, cos) = (AZIMUTH + azimuth).to_radians().sin_cos();
    let (up, flat) = (ELEVATION + elevation).to_radians().sin_cos();
    let forward = [flat * cos, flat * sin, up];
    let place = std::array::from_fn(|k| LOOK_AT[k] - DISTANCE * forward[k]);
    (place, [sin, -cos, 0.0, -up * cos, -up * sin, flat])
}

fn camera() -> Control {
    let space = Space::uniform_box(Dtype::F64, &[1, 2], -10.0, 10.0);
    let default = Value { shape: vec![1, 2], ..Value::vector(&[0.0, 0.0]) };
    let doc = "turns the camera about what it looks at: azimuth and elevation, degrees";
    let factor = Factor::new("camera.angle_delta", space, default).doc(doc).sampled_by_default();
    let effect = Effect::Model(|model, degrees| {
        let camera = model.id(Object::Camera, VIEW)?;
        let (place, _) = view([degrees[0], degrees[1]]);
        model.cam_pos_mut()[3 * camera..][..3].copy_from_slice(&place);
        // About z by the azimuth, which counts from x where a camera looks along y, then about x up from looking down.
        let (sin_z, cos_z) = ((AZIMUTH + degrees[0] - 90.0).to_radians() / 2.0).sin_cos();
        let (sin_x, cos_x) = ((ELEVATION + degrees[1] + 90.0).to_radians() / 2.0).sin_cos();
        let turn = [cos_z * cos_x, cos_z * sin_x, sin_z * sin_x, sin_z * cos_x];
        model.cam_quat_mut()[4 * camera..][..4].copy_from_slice(&turn);
        Ok(())
    });
    Control { factor, effect }
}

fn transparent_arm() -> Control {
    const ALPHA: f32 = 0.3;
    let doc = "1: the robot is transparent";
    let factor = Factor::integer("rendering.transparent_arm", 0, 1, 0).doc(doc);
    let effect = Effect::Model(|model, value| {
        if value[0] != 0.0 {
            let names = model.names(Object::Geom);
            let colors = model.geom_rgba_mut().chunks_exact_mut(4);
            for (_, color) in names.iter().zip(colors).filter(|(name, _)| name.starts_with("robot0:")) {
                color[3] = ALPHA;
            }
        }
        Ok(())
    });
    Control { factor, effect }
}

fn mass() -> Control {
    let factor = boxed(MASS, [&[0.01], &[50.0]], &[2.0], "mass of the block or puck, kg; its inertia stays");
    Control { factor, effect: Effect::Model(|model, mass| set_mass(model, mass[0])) }
}

/// Gives the object a mass, kg.
pub(super) fn set_mass(model: &mut Model, mass: f64) -> Result<(), MujocoError> {
    let body = model.id(Object::Body, "object0")?;
    model.body_mass_mut()[body] = mass;
    Ok(())
}

fn gripper(task: Task) -> Factor {
    let [x, y, _] = task.gripper();
    let (low, high) = if task == Task::Slide { ([0.9, 0.6], [1.1, 0.9]) } else { ([1.25, 0.6], [1.45, 0.9]) };
    boxed(GRIPPER, [&low, &high], &[x, y], "x, y of the gripper at the start, m, met to a few mm")
}

fn object(task: Task) -> Factor {
    let ([x, y, _], range) = (task.gripper(), task.object_range());
    let bounds: [&[f64]; 2] = [&[x - range, y - range], &[x + range, y + range]];
    let doc = "x, y of the block or puck at the start, m";
    boxed(OBJECT, bounds, &task.object_by_default(), doc).sampled_by_default()
}

fn goal(task: Task) -> Factor {
    let [low, high] = task.goals();
    let default = [1.3, 0.74, 0.4247_f64.clamp(low[2], high[2])];
    boxed(GOAL, [&low, &high], &default, "x, y, z of the goal, m").sampled_by_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fetch::models::Shared;

    /// The camera as a factor turns it, and as it is compiled.
    #[test]
    fn the_factor_turns_the_camera_about_what_it_looks_at() {
        let shared = Shared::get(Task::Reach).unwrap();
        let camera = shared.model.id(Object::Camera, VIEW).unwrap();
        let quaternion =
            |model: &Model| -> [f64; 4] { std::array::from_fn(|k| model.cam_quat()[4 * camera + k]) };
        let Control { effect, .. } = super::camera();
        for degrees in [[0.0, 0.0], [10.0, -10.0]] {
            let mut model = Model::clone(&shared.model);
            effect.edit_model(&mut model, &degrees).unwrap();
            let [w, x, y, z] = quaternion(&model);
            // The third axis, away from what is seen, leads from there to the camera.
            let back = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
            for (k, back) in back.into_iter().enumerate() {
                let seen = model.cam_pos()[3 * camera + k] - DISTANCE * back;
                assert!((seen - LOOK_AT[k]).abs() < 1e-12, "{degrees:?}");
            }
        }
        let mut model = Model::clone(&shared.model);
        effect.edit_model(&mut model, &[0.0, 0.0]).unwrap();
        let dot: f64 = quaternion(&model).iter().zip(quaternion(&shared.model)).map(|(a, b)| a * b).sum();
        assert!((dot.abs() - 1.0).abs() < 1e-12, "{dot}");
    }
}
