//! The factors of variation, and what each does to the model. Those of starts and goals are read when an episode begins.

use swm_core::{Dtype, Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::models::PUCK;
use super::robot::JOINT;
use super::task::{Paint, STRIDE, Task};
use crate::suite::{Control, Effect, set_color};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// Where the object, or what it belongs to, starts.
pub(super) const OBJECT: &str = "object.position";
/// Where the goal is.
pub(super) const GOAL: &str = "goal.position";
/// Where the hand starts.
pub(super) const HAND: &str = "agent.start_position";
/// The size of the puck.
pub(super) const SCALE: &str = "object.scale";
/// How far an action of 1 moves the hand.
const STRIDE_OF: &str = "agent.action_scale";
/// The color of the arm in the file.
const ARM: [f32; 3] = [0.5, 0.1, 0.1];
/// The cameras that a factor turns, and what it turns them about, m.
const CAMERAS: [&str; 5] = ["corner", "corner2", "corner3", "corner4", "topview"];
const MIDDLE: [f64; 3] = [0.0, 0.6, 0.1];

/// The factors of a task with what they do, in the order of their columns.
pub(super) fn controls(task: &Task) -> Vec<Control> {
    let color = |name: &str, default: [f64; 3], doc: &str, effect: Effect| {
        let factor = boxed(name, [&[0.0; 3], &[1.0; 3]], &default, doc).sampled_by_default();
        Control { factor, effect }
    };
    let model = |factor: Factor, edit| Control { factor, effect: Effect::Model(edit) };
    let (paint, own) = task.paint;
    let painted = match paint {
        Paint::Material(name) => Effect::Material(name),
        Paint::Geom("peg") => Effect::Model(|model, rgb| paint_geom(model, "peg", rgb)),
        Paint::Geom(_) => Effect::Model(|model, rgb| paint_geom(model, "objGeom", rgb)),
    };
    let texture = |name: &str, doc: &str| Factor::integer(name, 0, 1, 0).choices(&["file", "plain"]).doc(doc);
    let number = |name: &str, [low, high, default]: [f64; 3], doc: &str| {
        boxed(name, [&[low], &[high]], &[default], doc)
    };
    let mut controls = vec![
        color(
            "table.color",
            [1.0; 3],
            "color of the table, times its texture",
            Effect::Material("table_wood"),
        ),
        color("object.color", own, "color of what is moved", painted),
        color(
            "background.color",
            [1.0; 3],
            "color of the floor, times its texture",
            Effect::Material("basic_floor"),
        ),
        model(texture("table.texture", "texture of the table"), |model, value| {
            hide_texture(model, "table_wood", value)
        }),
        model(texture("floor.texture", "texture of the floor"), |model, value| {
            hide_texture(model, "basic_floor", value)
        }),
        model(
            number("light.intensity", [0.0, 1.0, 0.3], "diffuse brightness of the three lights")
                .sampled_by_default(),
            |model, value| {
                model.light_diffuse_mut().fill(value[0] as f32);
                Ok(())
            },
        ),
        model(
            Factor::integer("rendering.transparent_arm", 0, 1, 0).doc("1: the arm is transparent"),
            |model, value| arm(model, |color| color[3] = if value[0] == 0.0 { color[3] } else { 0.25 }),
        ),
        model(
            boxed("agent.color", [&[0.0; 3], &[1.0; 3]], &ARM.map(widened), "color of the arm"),
            |model, rgb| arm(model, |color| set_color(color, rgb)),
        ),
        camera(),
    ];
    controls.extend(starts(task).map(|factor| Control { factor, effect: Effect::Start }));
    let physics = &task.physics;
    if physics.is_puck {
        controls.push(Control {
            factor: number(
                SCALE,
                [0.8, 1.2, 1.0],
                "size of the puck, times 0.02 m of radius and half height",
            ),
            effect: Effect::Spec(|spec, scale| {
                spec.geom("objGeom")?.set_size([PUCK * scale[0], PUCK * scale[0], 0.0]);
                Ok(())
            }),
        });
        let doc =
            "sliding friction of the puck, which decides where it is not 1 (else the larger of two things')";
        controls.push(model(number("object.friction", [0.3, 2.0, 1.0], doc), |model, value| {
            if value[0] != 1.0 {
                let puck = model.id(Object::Geom, "objGeom")?;
                model.geom_priority_mut()[puck] = 1;
                model.geom_friction_mut()[3 * puck] = value[0];
            }
            Ok(())
        }));
    }
    if let Some((body, bounds)) = physics.mass {
        let factor = number("object.mass", bounds, "mass of what is moved, kg; its inertia stays");
        controls.push(match body {
            "peg" => model(factor, |model, value| set_mass(model, "peg", value[0])),
            _ => model(factor, |model, value| set_mass(model, "obj", value[0])),
        });
    }
    if let Some([low, high]) = physics.grip {
        let doc = "strength of the actuators of the fingers, N/m";
        controls.push(model(number("agent.gripper_strength", [low, high, 400.0], doc), |model, value| {
            model.actuator_gainprm_mut().chunks_exact_mut(10).for_each(|gain| gain[0] = value[0]);
            model.actuator_biasprm_mut().chunks_exact_mut(10).for_each(|bias| bias[1] = -value[0]);
            Ok(())
        }));
        controls.push(model(
            number("gravity", [-20.0, -4.9, -9.81], "acceleration along z, m/s²"),
            |model, value| {
                model.set_gravity([0.0, 0.0, value[0]]);
                Ok(())
            },
        ));
    }
    if let Some(bounds) = physics.damping {
        let doc = "damping of the joint of what is moved";
        controls.push(model(number("joint.damping", bounds, doc), |model, value| {
            model.dof_damping_mut()[JOINT] = value[0];
            Ok(())
        }));
    }
    if let Some([low, high]) = physics.stride {
        let doc = "how far an action of 1 moves the target of the hand, m";
        let factor = number(STRIDE_OF, [low, high, STRIDE], doc);
        controls.push(Control { factor, effect: Effect::Start });
    }
    controls
}

/// Where hand, object and goal start.
fn starts(task: &Task) -> impl Iterator<Item = Factor> {
    let middle =
        |[low, high]: &[[f64; 3]; 2]| -> [f64; 3] { std::array::from_fn(|k| f64::midpoint(low[k], high[k])) };
    let [x, y, z] = task.hand;
    let [left, right] = task.physics.sideways;
    let bounds: [&[f64]; 2] = [&[x + left, y, z], &[x + right, y + 0.1, z + 0.15]];
    let hand = boxed(HAND, bounds, &task.hand, "where the hand is driven to before an episode, m");
    let [low, high] = &task.object;
    let doc = match task.fixture {
        Some((_, false)) => "x, y of what holds the moved part, m",
        _ => "x, y of the object at the start, m",
    };
    let object = boxed(OBJECT, [&low[..2], &high[..2]], &middle(&task.object)[..2], doc).sampled_by_default();
    let goal = task.goal.as_ref().map(|(bounds, dim)| {
        let doc = match task.fixture {
            Some(_) => "x, y, z of the block with the hole, m",
            None => "where the goal is, m",
        };
        let [low, high] = bounds;
        boxed(GOAL, [&low[..*dim], &high[..*dim]], &middle(bounds)[..*dim], doc).sampled_by_default()
    });
    [Some(hand), Some(object), goal].into_iter().flatten()
}

/// The space of these factors.
pub(super) fn space(task: &Task, controls: &[Control]) -> FovSpace {
    let space = FovSpace::new(controls.iter().map(|control| control.factor.clone()).collect());
    let (words, holds): (_, fn(&Fov) -> bool) = match task.apart {
        0.0 => return space,
        apart if apart < 0.15 => ("at least 0.1 m from the object along x and y", |fov| apart_by(fov, 0.1)),
        _ => ("at least 0.15 m from the object along x and y", |fov| apart_by(fov, 0.15)),
    };
    space.with_constraints(vec![Constraint { owner: GOAL, reads: &[OBJECT], words, holds }])
}

fn apart_by(fov: &Fov, least: f64) -> bool {
    let ([x, y, _], [a, b, _]) = (values(fov, OBJECT), values(fov, GOAL));
    ((x - a) * (x - a) + (y - b) * (y - b)).sqrt() >= least
}

/// The values of a factor, and zeros behind them.
pub(super) fn values(fov: &Fov, name: &str) -> [f64; 3] {
    let values = fov.value(name).to_f64s(name).expect("factors are numbers");
    std::array::from_fn(|k| values.get(k).copied().unwrap_or_default())
}

/// The value of a factor.
pub(super) fn scalar(fov: &Fov, name: &str) -> f64 {
    values(fov, name)[0]
}

/// Where the object and the goal are: the factors, and the heights that are no factors.
pub(super) fn placed(task: &Task, fov: &Fov) -> [[f64; 3]; 2] {
    let [x, y, _] = values(fov, OBJECT);
    let height = task.object[0][2] * if task.physics.is_puck { scalar(fov, SCALE) } else { 1.0 };
    [[x, y, height], if task.goal.is_some() { values(fov, GOAL) } else { [0.0; 3] }]
}

/// How far an action of 1 moves the hand, m.
pub(super) fn stride(task: &Task, fov: &Fov) -> f32 {
    if task.physics.stride.is_some() { scalar(fov, STRIDE_OF) as f32 } else { STRIDE as f32 }
}

/// Puts what holds the moved part, or the hole, to its place.
pub(super) fn place_fixture(task: &Task, fov: &Fov, model: &mut Model) -> Result<(), MujocoError> {
    let Some((name, is_at_goal)) = task.fixture else { return Ok(()) };
    let body = model.id(Object::Body, name)?;
    let place = placed(task, fov)[usize::from(is_at_goal)];
    model.body_pos_mut()[3 * body..][..3].copy_from_slice(&place);
    Ok(())
}

fn boxed(name: &str, [low, high]: [&[f64]; 2], default: &[f64], doc: &str) -> Factor {
    let shape = vec![default.len()];
    let space = Space::Box { dtype: Dtype::F64, shape, low: low.to_vec(), high: high.to_vec() };
    Factor::new(name, space, Value::vector(default)).doc(doc)
}

/// The number that was written, of one in single precision.
fn widened(value: f32) -> f64 {
    (f64::from(value) * 1e6).round() / 1e6
}

fn paint_geom(model: &mut Model, name: &str, rgb: &[f64]) -> Result<(), MujocoError> {
    let geom = model.id(Object::Geom, name)?;
    set_color(&mut model.geom_rgba_mut()[4 * geom..], rgb);
    Ok(())
}

fn hide_texture(model: &mut Model, material: &str, value: &[f64]) -> Result<(), MujocoError> {
    let material = model.id(Object::Material, material)?;
    if value[0] != 0.0 {
        model.mat_texid_mut()[10 * material..][..10].fill(-1);
    }
    Ok(())
}

/// Edits the colors of the visible parts of the arm.
fn arm(model: &mut Model, edit: impl Fn(&mut [f32])) -> Result<(), MujocoError> {
    let parts = model.geom_rgba_mut().chunks_exact_mut(4);
    parts.filter(|color| color[..3] == ARM && color[3] > 0.0).for_each(edit);
    Ok(())
}

fn set_mass(model: &mut Model, body: &str, mass: f64) -> Result<(), MujocoError> {
    let body = model.id(Object::Body, body)?;
    model.body_mass_mut()[body] = mass;
    Ok(())
}

fn camera() -> Control {
    let space = Space::uniform_box(Dtype::F64, &[1, 2], -10.0, 10.0);
    let default = Value { shape: vec![1, 2], ..Value::vector(&[0.0, 0.0]) };
    let doc = "turns the corner cameras and `topview` about (0, 0.6, 0.1): azimuth and elevation, degrees";
    let factor = Factor::new("camera.angle_delta", space, default).doc(doc).sampled_by_default();
    let effect = Effect::Model(|model, degrees| {
        for name in CAMERAS.into_iter().filter(|_| degrees.iter().any(|angle| *angle != 0.0)) {
            let camera = model.id(Object::Camera, name)?;
            let place = &mut model.cam_pos_mut()[3 * camera..][..3];
            let off: [f64; 3] = std::array::from_fn(|k| place[k] - MIDDLE[k]);
            // About z by the azimuth; up by the elevation about the horizontal axis across the view.
            let flat = off[0].hypot(off[1]);
            let about = |axis: [f64; 3], angle: f64| {
                let (sin, cos) = (angle.to_radians() / 2.0).sin_cos();
                [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
            };
            let up = about([-off[1] / flat, off[0] / flat, 0.0], -degrees[1]);
            let turn = product(about([0.0, 0.0, 1.0], degrees[0]), up);
            let [_, x, y, z] = product(
                product(turn, [0.0, off[0], off[1], off[2]]),
                [turn[0], -turn[1], -turn[2], -turn[3]],
            );
            place.copy_from_slice(&[MIDDLE[0] + x, MIDDLE[1] + y, MIDDLE[2] + z]);
            let own = &mut model.cam_quat_mut()[4 * camera..][..4];
            let turned = product(turn, [own[0], own[1], own[2], own[3]]);
            own.copy_from_slice(&turned);
        }
        Ok(())
    });
    Control { factor, effect }
}

/// The product of two quaternions w x y z.
fn product([a, b, c, d]: [f64; 4], [e, f, g, h]: [f64; 4]) -> [f64; 4] {
    [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]
}
