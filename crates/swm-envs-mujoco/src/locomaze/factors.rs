//! The factors of variation: those of the reference's mazes, and what is felt in each body.

use swm_core::{Dtype, Space, Value};
use swm_fov::{Factor, Fov, FovSpace};

use super::{Body, soccer};
use crate::suite::{Control, Effect};

/// The two colors of the floor.
pub(super) const FLOOR_COLOR: &str = "floor.color";
/// Whether the floor's color says where one is.
pub(super) const ENCODING: &str = "floor.pixel_encoding";
/// How far an action of length 1 moves the point, m.
pub(super) const SPEED: &str = "agent.speed";

/// The colors of the floor, the file's own.
const FLOOR: [f64; 6] = [0.08, 0.11, 0.16, 0.15, 0.18, 0.25];
/// What motors of the ant turn an action of 1 into, N m.
const TORQUE: f64 = 30.0;

/// The factors of a body with what they do, in the order of their columns.
pub(super) fn controls(body: Body) -> Vec<Control> {
    let (color, light) = ([0.7, 0.5, 0.3], 1.0);
    let mut controls = vec![
        Control {
            factor: uniform("agent.color", &[3], [0.0, 1.0], &color, "color of what moves"),
            effect: Effect::Material("self"),
        },
        Control {
            factor: uniform("wall.color", &[3], [0.0, 1.0], &[1.0; 3], "color of the walls"),
            effect: Effect::Material("wall"),
        },
        // Only images have the floor's texture: see `models`.
        Control {
            factor: uniform(FLOOR_COLOR, &[2, 3], [0.0, 1.0], &FLOOR, "the two colors of the floor's checker"),
            effect: Effect::Start,
        },
        Control {
            factor: Factor::integer(ENCODING, 0, 1, 0)
                .doc("1: instead of a checker, the floor's red and green tell y and x, as in OGBench's tasks on pixels"),
            effect: Effect::Start,
        },
        Control {
            factor: uniform("light.intensity", &[1], [0.0, 1.0], &[light], "diffuse brightness of the light"),
            effect: Effect::Light("global"),
        },
    ];
    controls.push(match body {
        Body::Point => Control {
            factor: uniform(
                SPEED,
                &[1],
                [0.1, 0.4],
                &[0.2],
                "how far an action of length 1 moves the ball, m",
            ),
            effect: Effect::Start,
        },
        Body::Humanoid => Control {
            factor: uniform(
                "agent.torque_scale",
                &[1],
                [0.5, 2.0],
                &[1.0],
                "torque of an action of 1, times the file's 20 to 120 N m",
            ),
            effect: Effect::Model(|model, scale| {
                model.actuator_gear_mut().chunks_exact_mut(6).for_each(|gear| gear[0] *= scale[0]);
                Ok(())
            }),
        },
        Body::Ant | Body::AntSoccer => Control {
            factor: uniform("agent.torque", &[1], [15.0, 60.0], &[TORQUE], "torque of an action of 1, N m"),
            effect: Effect::Model(|model, torque| {
                model.actuator_gear_mut().chunks_exact_mut(6).for_each(|gear| gear[0] = torque[0]);
                Ok(())
            }),
        },
    });
    if body != Body::Point {
        controls.push(Control {
            factor: uniform(
                "floor.friction",
                &[1],
                [0.2, 1.0],
                &[1.0],
                "sliding friction between feet and floor",
            ),
            effect: Effect::FloorFriction("floor"),
        });
    }
    if body.has_ball() {
        controls.extend(soccer::controls());
    }
    controls
}

/// The space of these factors.
pub(super) fn space(controls: &[Control]) -> FovSpace {
    FovSpace::new(controls.iter().map(|control| control.factor.clone()).collect())
}

pub(super) fn uniform(
    name: &str,
    shape: &[usize],
    [low, high]: [f64; 2],
    default: &[f64],
    doc: &str,
) -> Factor {
    let count = default.len();
    let space = Space::Box {
        dtype: Dtype::F64,
        shape: shape.to_vec(),
        low: vec![low; count],
        high: vec![high; count],
    };
    Factor::new(name, space, Value { shape: shape.to_vec(), ..Value::vector(default) }).doc(doc)
}

/// The values of a factor.
pub(super) fn factor_values(fov: &Fov, name: &str) -> Vec<f64> {
    fov.value(name).to_f64s(name).expect("factors are numbers")
}

/// Whether the floor's color says where one is.
pub(super) fn is_encoded(fov: &Fov) -> bool {
    factor_values(fov, ENCODING)[0] != 0.0
}

/// What becomes of the colors of the floor's checker: its own two become these.
pub(super) fn floor_colors(rgb: &[f64]) -> impl Fn([u8; 3]) -> [u8; 3] + use<> {
    let bytes = |values: &[f64]| [0, 1, 2].map(|k| (255.0 * values[k]) as u8);
    let (first, new_first, new_second) = (bytes(&FLOOR[..3]), bytes(&rgb[..3]), bytes(&rgb[3..]));
    move |color| if color == first { new_first } else { new_second }
}
