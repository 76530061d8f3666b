//! The factors that the domains share, with the reference's names, spaces and defaults.

use swm_core::{Dtype, Space, Value};
use swm_fov::Factor;

use super::effect::{Control, Effect, set_color};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// A color, `[3]`, 0..1.
pub fn color(name: &str, default: [f64; 3], doc: &str, effect: Effect) -> Control {
    let space = Space::uniform_box(Dtype::F64, &[3], 0.0, 1.0);
    Control { factor: Factor::new(name, space, Value::vector(&default)).doc(doc), effect }
}

/// `agent.color`: the material `self`.
pub fn agent_color(default: [f64; 3]) -> Control {
    color("agent.color", default, "color of the agent", Effect::Material("self"))
}

/// `floor.color`, `[2, 3]`: the checker `grid`.
pub fn floor_color() -> Control {
    let space = Space::uniform_box(Dtype::F64, &[2, 3], 0.0, 1.0);
    let default = Value { shape: vec![2, 3], ..Value::vector(&[0.1, 0.2, 0.3, 0.2, 0.3, 0.4]) };
    let factor = Factor::new("floor.color", space, default).doc("the two colors of the floor's checker");
    Control { factor, effect: Effect::Checker("grid") }
}

/// `light.intensity`, `[1]`: the diffuse part of a light. The headlight stays, so that 0 is not dark.
pub fn light_intensity(light: &'static str, default: f64) -> Control {
    let space = Space::uniform_box(Dtype::F64, &[1], 0.0, 1.0);
    let factor = Factor::new("light.intensity", space, Value::vector(&[default]))
        .doc("diffuse brightness of the light; the headlight stays");
    Control { factor, effect: Effect::Light(light) }
}

/// `floor.friction`, `[1]`, f32; see [`Effect::FloorFriction`].
pub fn floor_friction(floor: &'static str, default: f32) -> Control {
    let doc = "sliding friction of contacts with the floor, as a share of the friction at 1; at least 0.01";
    scalar("floor.friction", [0.0, 1.0], default, doc, Effect::FloorFriction(floor))
}

/// A density, `[1]`, f32, 500..1500 kg/m³; 1000 by default. For [`Effect::Density`] and [`Effect::Mass`].
pub fn density(name: &str, doc: &str, effect: Effect) -> Control {
    scalar(name, [500.0, 1500.0], 1000.0, doc, effect)
}

/// A number as `[1]`, f32, as the reference declares most.
pub fn scalar(name: &str, [low, high]: [f64; 2], default: f32, doc: &str, effect: Effect) -> Control {
    let space = Space::uniform_box(Dtype::F32, &[1], low, high);
    Control { factor: Factor::new(name, space, Value::vector(&[default])).doc(doc), effect }
}

/// A switch, 0 or 1.
pub fn switch(name: &str, default: i64, doc: &str, effect: Effect) -> Control {
    Control { factor: Factor::integer(name, 0, 1, default).doc(doc), effect }
}

/// `target.shape`: 0 a cube, 1 (the default) a ball.
pub fn target_shape(doc: &str, effect: Effect) -> Control {
    let control = switch("target.shape", 1, doc, effect);
    Control { factor: control.factor.choices(&["cube", "ball"]), ..control }
}

/// `target.color`, of a site `target` that the suite hides.
pub fn hidden_target_color() -> Control {
    const DEFAULT: [f64; 3] = [0.6, 0.3, 0.3];
    let doc = "color of the target, which is rendered where its color or shape is not the default";
    let show = |model: &mut Model, values: &[f64]| {
        if values != DEFAULT {
            let site = show_site(model, "target")?;
            set_site_color(model, site, values);
        }
        Ok(())
    };
    color("target.color", DEFAULT, doc, Effect::Model(show))
}

/// `….…_locked`: 0 holds the joint, 1 (the default) leaves it free.
pub fn locked(name: &str, joint: &'static str) -> Control {
    let doc = format!("1: free; 0: the joint `{joint}` is held at its angle of the start");
    switch(name, 1, &doc, Effect::Lock(joint))
}

/// The index of a site, which is drawn from now on: the suite hides some targets.
///
/// # Errors
///
/// [`MujocoError::NoObject`].
pub fn show_site(model: &mut Model, name: &str) -> Result<usize, MujocoError> {
    let site = model.id(Object::Site, name)?;
    model.site_group_mut()[site] = 0;
    Ok(site)
}

/// Gives a site its own color.
pub fn set_site_color(model: &mut Model, site: usize, rgb: &[f64]) {
    set_color(&mut model.site_rgba_mut()[4 * site..], &own_color(rgb));
}

/// Gives geoms a color of their own.
///
/// # Errors
///
/// [`MujocoError::NoObject`].
pub fn set_geom_color(model: &mut Model, names: &[&str], rgb: &[f64]) -> Result<(), MujocoError> {
    for name in names {
        let geom = model.id(Object::Geom, name)?;
        set_color(&mut model.geom_rgba_mut()[4 * geom..], &own_color(rgb));
    }
    Ok(())
}

/// A color that MuJoCo does not take for "that of the material", as it does half gray.
fn own_color(rgb: &[f64]) -> [f64; 3] {
    let color = [rgb[0], rgb[1], rgb[2]];
    if color == [0.5; 3] { [0.5, 0.5, 0.501] } else { color }
}
