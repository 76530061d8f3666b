//! The factors of variation: names, spaces and defaults of the reference, and what each does to the model. Those of starts
//! and goals are read when an episode begins.

use swm_core::{Dtype, Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

use super::compose::{GRIPPER_MATERIALS, row_of_cubes};
use super::layout::{CAMERAS, CUBE_COLORS, FLOOR, HALF_SIZE, Kind, PURPLE, RED};
use super::pose;
use super::settings::Mode;
use crate::suite::{Control, Effect, set_color};
use crate::views::CheckerColors;
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Spec};

/// The factors of a table with what they do, in the order of their columns.
pub(super) fn controls(kind: Kind, mode: Mode) -> Vec<Control> {
    let mut controls =
        vec![agent_color(), start_of_effector(kind), camera(kind), cube_color(kind), cube_size(kind)];
    // Tasks say where things start and belong.
    if mode == Mode::DataCollection {
        controls.extend(places(kind));
    }
    controls.push(floor_color());
    controls.push(light(kind));
    if kind == Kind::Scene {
        controls.push(lock_color());
    }
    controls
}

/// The space of these factors.
pub(super) fn space(kind: Kind, mode: Mode, controls: &[Control]) -> FovSpace {
    let space = FovSpace::new(controls.iter().map(|control| control.factor.clone()).collect());
    if kind.cubes() == 1 || mode == Mode::Task {
        return space;
    }
    space.with_constraints(vec![Constraint {
        owner: START_POSITION,
        reads: &[SIZE],
        words: "such that no two cubes overlap",
        holds: |fov| are_apart(fov, START_POSITION),
    }])
}

/// Where the effector starts.
pub(super) const EFFECTOR: &str = "agent.ee_start_position";
/// Half the sides of the cubes.
pub(super) const SIZE: &str = "cube.size";
/// Where the cubes start.
pub(super) const START_POSITION: &str = "cube.start_position";
/// How the cubes are turned at the start.
pub(super) const START_YAW: &str = "cube.start_yaw";
/// Where the cubes belong.
pub(super) const GOAL_POSITION: &str = "cube.goal_position";
/// How the cubes are turned at their goals.
pub(super) const GOAL_YAW: &str = "cube.goal_yaw";
/// The colors of the floor.
pub(super) const FLOOR_COLOR: &str = "floor.color";
/// The colors of locked things.
pub(super) const LOCK_COLOR: &str = "lock_color";

/// The values of a factor.
pub(super) fn factor_values(fov: &Fov, name: &str) -> Vec<f64> {
    fov.value(name).to_f64s(name).expect("factors are numbers")
}

/// Whether cubes at these positions overlap in no way of turning them.
fn are_apart(fov: &Fov, positions: &str) -> bool {
    let (at, sizes) = (factor_values(fov, positions), factor_values(fov, SIZE));
    let places: Vec<[f64; 2]> = at.chunks_exact(2).map(|xy| [xy[0], xy[1]]).collect();
    let overlap = |i: usize, j: usize| {
        pose::distance(places[i], places[j]) <= (sizes[i] + sizes[j]) * std::f64::consts::SQRT_2
    };
    !(0..places.len()).any(|i| (0..i).any(|j| overlap(i, j)))
}

fn factor(name: &str, shape: &[usize], bounds: (Vec<f64>, Vec<f64>), default: &[f64], doc: &str) -> Factor {
    let space = Space::Box { dtype: Dtype::F64, shape: shape.to_vec(), low: bounds.0, high: bounds.1 };
    let default = Value { shape: shape.to_vec(), ..Value::vector(default) };
    Factor::new(name, space, default).doc(doc)
}

fn uniform(name: &str, shape: &[usize], [low, high]: [f64; 2], default: &[f64], doc: &str) -> Factor {
    let count = default.len();
    factor(name, shape, (vec![low; count], vec![high; count]), default, doc)
}

/// The middle of a box.
fn middle<const N: usize>([low, high]: [[f64; N]; 2]) -> [f64; N] {
    std::array::from_fn(|k| (low[k] + high[k]) / 2.0)
}

fn agent_color() -> Control {
    let factor = uniform("agent.color", &[3], [0.0, 1.0], &PURPLE, "color of the gripper");
    let effect = Effect::Model(|model, rgb| {
        for name in GRIPPER_MATERIALS {
            let material = model.id(Object::Material, name)?;
            set_color(&mut model.mat_rgba_mut()[4 * material..], rgb);
        }
        Ok(())
    });
    Control { factor, effect }
}

fn start_of_effector(kind: Kind) -> Control {
    let [low, high] = kind.bounds().arm;
    let default = middle([low, high]);
    let doc = "where the effector starts, m";
    let factor = factor(EFFECTOR, &[3], (low.to_vec(), high.to_vec()), &default, doc);
    Control { factor, effect: Effect::Start }
}

fn camera(kind: Kind) -> Control {
    let most = if kind == Kind::Scene { 5.0 } else { 10.0 };
    let doc = "turns the cameras: yaw about the vertical and pitch about their own x axis, degrees";
    let factor = uniform("camera.angle_delta", &[1, 2], [-most, most], &[0.0, 0.0], doc);
    let effect = Effect::Model(|model, degrees| {
        let (yaw, pitch) = (degrees[0].to_radians(), degrees[1].to_radians());
        for name in CAMERAS {
            let camera = model.id(Object::Camera, name)?;
            let quaternion = &mut model.cam_quat_mut()[4 * camera..4 * camera + 4];
            let stock = [quaternion[0], quaternion[1], quaternion[2], quaternion[3]];
            let pitched = pose::multiply(stock, pose::about([1.0, 0.0, 0.0], pitch));
            quaternion.copy_from_slice(&pose::multiply(pose::about_z(yaw), pitched));
        }
        Ok(())
    });
    Control { factor, effect }
}

/// The geoms of a cube and of the marker of its goal.
fn geoms_of_cube(index: usize) -> [String; 2] {
    [format!("object_{index}"), format!("target_object_{index}")]
}

fn cube_color(kind: Kind) -> Control {
    let count = kind.cubes();
    let doc = "colors of the cubes and of the markers of their goals";
    let factor = uniform("cube.color", &[count, 3], [0.0, 1.0], CUBE_COLORS[..count].as_flattened(), doc);
    let effect = Effect::Model(|model, rgbs| {
        for (index, rgb) in rgbs.chunks_exact(3).enumerate() {
            for name in geoms_of_cube(index) {
                let geom = model.id(Object::Geom, &name)?;
                set_color(&mut model.geom_rgba_mut()[4 * geom..], rgb);
            }
        }
        Ok(())
    });
    Control { factor, effect }
}

fn cube_size(kind: Kind) -> Control {
    let count = kind.cubes();
    let doc =
        "half the sides of the cubes, m; their mass, the heights of starts and goals and of stacks follow";
    let factor = uniform(SIZE, &[count], [0.01, 0.03], &vec![HALF_SIZE; count], doc);
    Control { factor, effect: Effect::Spec(set_sizes) }
}

/// Gives the cubes and their markers these sizes.
pub(super) fn set_sizes(spec: &mut Spec, sizes: &[f64]) -> Result<(), MujocoError> {
    for (index, size) in sizes.iter().enumerate() {
        for name in geoms_of_cube(index) {
            spec.geom(&name)?.set_size([*size; 3]);
        }
    }
    Ok(())
}

/// Starts and goals. With more than one cube the defaults stand in a row, where the reference has all at one point.
fn places(kind: Kind) -> Vec<Control> {
    let count = kind.cubes();
    let [low, high] = kind.bounds().object;
    let row: Vec<[f64; 2]> = match kind {
        Kind::Cubes(_) => row_of_cubes(count).map(|y| [0.3, y]).collect(),
        Kind::Scene => vec![middle([low, high])],
    };
    let position = |name: &str, doc: &str| {
        factor(name, &[count, 2], (low.repeat(count), high.repeat(count)), row.as_flattened(), doc)
    };
    let turn = [0.0, std::f64::consts::TAU];
    let yaw = |name: &str, doc: &str| uniform(name, &[count], turn, &vec![0.0; count], doc);
    let factors = [
        position(START_POSITION, "x, y of the cubes at the start, m"),
        yaw(START_YAW, "turn of the cubes at the start, rad"),
        position(
            GOAL_POSITION,
            "x, y of the first target, of whichever cube it is, m; later ones are sampled",
        ),
        yaw(GOAL_YAW, "turn of the first target, rad"),
    ];
    factors
        .map(|factor| Control { factor: factor.sampled_by_default(), effect: Effect::Start })
        .into_iter()
        .collect()
}

fn floor_color() -> Control {
    let doc = "the two colors of the floor's checker";
    let factor = uniform(FLOOR_COLOR, &[2, 3], [0.0, 1.0], &FLOOR, doc);
    // Only images have the floor's texture: see `models`.
    Control { factor, effect: Effect::Start }
}

fn light(kind: Kind) -> Control {
    let default = if kind == Kind::Scene { 0.6 } else { 0.7 };
    let doc = "diffuse brightness of the light; spotlight and headlight stay";
    let factor = uniform("light.intensity", &[1], [0.0, 1.0], &[default], doc);
    Control { factor, effect: Effect::Light("global") }
}

fn lock_color() -> Control {
    let doc = "colors of a locked drawer and window, and of the buttons that lock them";
    let factor = uniform(LOCK_COLOR, &[2, 3], [0.0, 1.0], [RED, RED].as_flattened(), doc);
    Control { factor, effect: Effect::Start }
}

/// What becomes of the colors of the floor.
pub(super) fn floor_colors(rgb: &[f64]) -> CheckerColors {
    CheckerColors::new(&FLOOR, rgb)
}

/// Turns the marker of a goal visible, or hides it.
pub(super) fn show_marker(model: &mut Model, geom: usize, is_shown: bool) {
    model.geom_rgba_mut()[4 * geom + 3] = if is_shown { 0.2 } else { 0.0 };
}
