//! What a factor of variation does to a model: a few lines of data per factor.
//!
//! Every effect sets absolute values and is applied to a fresh copy, so that nothing has to be undone: the next reset
//! begins again from the untouched model.

use swm_fov::Factor;

use crate::error::MujocoError;
use crate::ffi::{Model, Object, Spec};

/// A factor and what it does.
pub struct Control {
    /// Name, space, default, words.
    pub factor: Factor,
    /// What it does.
    pub effect: Effect,
}

/// What a factor does. The effects that recompile cost a fraction of a millisecond at a reset, the others microseconds.
pub enum Effect {
    /// In place: the colour of a material; three numbers, 0..1.
    Material(&'static str),
    /// In place: the two colours of a built-in checker texture; six numbers, 0..1.
    Checker(&'static str),
    /// In place: the brightness of a light's diffuse colour; one number, 0..1.
    Light(&'static str),
    /// In place: the sliding friction between this geom, the floor, and everything else.
    ///
    /// MuJoCo takes the larger of two geoms' frictions, so that the floor's number alone says little. Here a value v gives
    /// the floor v, and the others at most v times what counts between them and a floor of 1: contacts slide by v times
    /// their friction at v = 1.
    FloorFriction(&'static str),
    /// In place: 0 holds a joint at its angle of the start, 1 leaves it free.
    ///
    /// Held by damping; by rotor inertia where the model integrates by Runge-Kutta, for which such damping is unstable.
    Lock(&'static str),
    /// Recompiles: the density of geoms, kg/m³. It counts for geoms without a mass of their own.
    Density(&'static [&'static str]),
    /// Recompiles: the mass of geoms that have one: so many kg at the value 1000.
    Mass {
        /// The geoms.
        geoms: &'static [&'static str],
        /// Mass of each at 1000, kg.
        kg: f64,
    },
    /// In place: anything else.
    Model(fn(&mut Model, &[f64]) -> Result<(), MujocoError>),
    /// Recompiles: anything else.
    Spec(fn(&mut Spec, &[f64]) -> Result<(), MujocoError>),
}

/// Damping, or rotor inertia, of a joint that is held.
const LOCK: f64 = 1e6;

impl Effect {
    /// Whether a change of the factor compiles the model anew.
    pub fn recompiles(&self) -> bool {
        matches!(self, Effect::Density(_) | Effect::Mass { .. } | Effect::Spec(_))
    }

    /// Edits the description; does nothing where the effect is in place.
    pub fn edit_spec(&self, spec: &mut Spec, values: &[f64]) -> Result<(), MujocoError> {
        match self {
            Effect::Density(geoms) => {
                for name in *geoms {
                    spec.geom(name)?.set_density(values[0]);
                }
                Ok(())
            }
            Effect::Mass { geoms, kg } => {
                for name in *geoms {
                    spec.geom(name)?.set_mass(kg * values[0] / 1000.0);
                }
                Ok(())
            }
            Effect::Spec(edit) => edit(spec, values),
            Effect::Material(_)
            | Effect::Checker(_)
            | Effect::Light(_)
            | Effect::FloorFriction(_)
            | Effect::Lock(_)
            | Effect::Model(_) => Ok(()),
        }
    }

    /// Edits a compiled model; does nothing where the effect recompiles.
    pub fn edit_model(&self, model: &mut Model, values: &[f64]) -> Result<(), MujocoError> {
        match self {
            Effect::Material(name) => {
                let material = model.id(Object::Material, name)?;
                set_colour(&mut model.mat_rgba_mut()[4 * material..], values);
                Ok(())
            }
            Effect::Checker(name) => {
                let texture = model.id(Object::Texture, name)?;
                draw_checker(model, texture, values);
                Ok(())
            }
            Effect::Light(name) => {
                let light = model.id(Object::Light, name)?;
                model.light_diffuse_mut()[3 * light..][..3].fill(values[0] as f32);
                Ok(())
            }
            Effect::FloorFriction(floor) => set_floor_friction(model, floor, values[0]),
            Effect::Lock(joint) => match values[0] {
                0.0 => lock(model, joint),
                _ => Ok(()),
            },
            Effect::Model(edit) => edit(model, values),
            Effect::Density(_) | Effect::Mass { .. } | Effect::Spec(_) => Ok(()),
        }
    }
}

/// Sets red, green and blue, and leaves what is behind them.
pub fn set_colour(target: &mut [f32], rgb: &[f64]) {
    for (target, value) in target.iter_mut().zip(&rgb[..3]) {
        *target = *value as f32;
    }
}

fn set_floor_friction(model: &mut Model, floor: &str, value: f64) -> Result<(), MujocoError> {
    let floor = model.id(Object::Geom, floor)?;
    let moving: Vec<usize> =
        model.geom_body().iter().enumerate().filter(|(_, body)| **body > 0).map(|(geom, _)| geom).collect();
    let friction = model.geom_friction_mut();
    for geom in moving {
        let own = friction[3 * geom];
        friction[3 * geom] = own.min(value * own.max(1.0));
    }
    friction[3 * floor] = value;
    Ok(())
}

fn lock(model: &mut Model, name: &str) -> Result<(), MujocoError> {
    let joint = model.id(Object::Joint, name)?;
    let (_, dof) = model.joint_addresses(joint);
    if model.integrates_by_rk4() {
        model.dof_armature_mut()[dof] = LOCK;
        model.set_constants()
    } else {
        model.dof_damping_mut()[dof] = LOCK;
        Ok(())
    }
}

/// The built-in checker of 2 × 2 fields, as MuJoCo's compiler draws it; a mark on the edge stays.
fn draw_checker(model: &mut Model, texture: usize, rgb: &[f64]) {
    let texture = model.texture(texture);
    let (height, width, channels) = (texture.height, texture.width, texture.channels);
    let byte = |value: f64| (255.0 * value) as u8;
    for (row, line) in texture.data.chunks_exact_mut(width * channels).enumerate() {
        for (column, pixel) in line.chunks_exact_mut(channels).enumerate() {
            let is_edge = row == 0 || column == 0 || row == height - 1 || column == width - 1;
            if is_edge {
                continue;
            }
            let is_first = (row < height / 2) == (column < width / 2);
            let colour = if is_first { &rgb[..3] } else { &rgb[3..6] };
            for (target, value) in pixel.iter_mut().zip(colour) {
                *target = byte(*value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checker_of_the_own_colours_is_the_compilers() {
        let mut spec = Spec::read(&crate::assets::suite_model("cheetah.xml").unwrap()).unwrap();
        let mut model = spec.compile().unwrap();
        let grid = model.id(Object::Texture, "grid").unwrap();
        let compiled = model.texture(grid).data.to_vec();
        Effect::Checker("grid").edit_model(&mut model, &[0.1, 0.2, 0.3, 0.2, 0.3, 0.4]).unwrap();
        assert!(model.texture(grid).data == compiled, "other pixels than the compiler's");
        Effect::Checker("grid").edit_model(&mut model, &[0.2, 0.3, 0.4, 0.1, 0.2, 0.3]).unwrap();
        assert!(model.texture(grid).data != compiled);
    }
}
