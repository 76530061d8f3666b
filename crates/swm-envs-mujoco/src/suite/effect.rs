//! What a factor of variation does to a model: a few lines of data per factor.
//!
//! Every effect sets absolute values and is applied to a fresh copy, so that nothing has to be undone: the next reset
//! begins again from the untouched model.

use swm_fov::Factor;

use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Spec};

/// A factor and what it does.
pub struct Control {
    /// Name, space, default, words.
    pub factor: Factor,
    /// What it does.
    pub effect: Effect,
}

/// What a factor does. The effects that recompile cost a fraction of a millisecond at a reset, the others microseconds.
pub enum Effect {
    /// In place: the color of a material; three values, 0..1.
    Material(&'static str),
    /// In place: the two colors of a built-in checker texture; six values, 0..1.
    Checker(&'static str),
    /// In place: the brightness of a light's diffuse color; one number, 0..1.
    Light(&'static str),
    /// In place: the sliding friction between this geom, the floor, and everything else.
    ///
    /// MuJoCo takes the larger of two geoms' frictions, so that the floor's number alone says little. Here a value v gives
    /// the floor v, and the others at most v times what counts between them and a floor of 1: contacts slide by v times
    /// their friction at v = 1. Below `LEAST_FRICTION` it counts as that.
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
    /// Nothing in the model: the environment reads the factor when an episode begins.
    Start,
    /// In place: anything else.
    Model(fn(&mut Model, &[f64]) -> Result<(), MujocoError>),
    /// Recompiles: anything else.
    Spec(fn(&mut Spec, &[f64]) -> Result<(), MujocoError>),
}

/// Contacts without friction make simulations diverge within an episode: cheetah, humanoid, quadruped, walker, hopper. With
/// 0.005, the hopper still does in one of 900 episodes of random actions, with 0.01 in none.
const LEAST_FRICTION: f64 = 1e-2;

/// Damping, or rotor inertia, of a joint that is held.
const LOCK: f64 = 1e6;

impl Effect {
    /// Whether a change of the factor compiles the model anew.
    pub fn recompiles(&self) -> bool {
        matches!(self, Effect::Density(_) | Effect::Mass { .. } | Effect::Spec(_))
    }

    /// The texture that it draws into: the one thing of images that the simulated model lacks.
    pub fn texture(&self) -> Option<&'static str> {
        if let Effect::Checker(name) = self { Some(name) } else { None }
    }

    /// Edits the description; does nothing where the effect is in place.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoObject`]: the description has no object of a name in the effect.
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
            | Effect::Start
            | Effect::Model(_) => Ok(()),
        }
    }

    /// Edits a compiled model; does nothing where the effect recompiles.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoObject`]: the model has no object of a name in the effect.
    pub fn edit_model(&self, model: &mut Model, values: &[f64]) -> Result<(), MujocoError> {
        match self {
            Effect::Material(name) => {
                let material = model.id(Object::Material, name)?;
                set_color(&mut model.mat_rgba_mut()[4 * material..], values);
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
            Effect::Density(_) | Effect::Mass { .. } | Effect::Spec(_) | Effect::Start => Ok(()),
        }
    }
}

/// Sets red, green and blue, and leaves what is behind them.
pub fn set_color(target: &mut [f32], rgb: &[f64]) {
    for (target, value) in target.iter_mut().zip(&rgb[..3]) {
        *target = *value as f32;
    }
}

fn set_floor_friction(model: &mut Model, floor: &str, value: f64) -> Result<(), MujocoError> {
    let floor = model.id(Object::Geom, floor)?;
    let moving: Vec<usize> =
        model.geom_body().iter().enumerate().filter(|(_, body)| **body > 0).map(|(geom, _)| geom).collect();
    let friction = model.geom_friction_mut();
    // A geom's own friction, rounded as factors are, means itself.
    let own = moving.iter().map(|geom| friction[3 * geom]).find(|own| *own as f32 == value as f32);
    let value = own.unwrap_or(value).max(LEAST_FRICTION);
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
            let color = if is_first { &rgb[..3] } else { &rgb[3..6] };
            for (target, value) in pixel.iter_mut().zip(color) {
                *target = byte(*value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use swm_mujoco::assets::suite_model;

    fn cheetah() -> Spec {
        Spec::read(&suite_model("cheetah.xml").unwrap()).unwrap()
    }

    /// An edit in place gives what the compiler makes of the same edit in the description.
    #[test]
    fn colors_and_light_are_those_of_a_recompile() {
        let mut spec = cheetah();
        let mut edited = spec.compile().unwrap();
        Effect::Material("self").edit_model(&mut edited, &[0.25, 0.5, 0.75]).unwrap();
        Effect::Light("light").edit_model(&mut edited, &[0.3]).unwrap();
        let checker = [0.9, 0.1, 0.33, 0.2, 0.77, 0.4];
        Effect::Checker("grid").edit_model(&mut edited, &checker).unwrap();
        spec.material("self").unwrap().set_rgba([0.25, 0.5, 0.75, 1.0]);
        spec.light("light").unwrap().set_diffuse([0.3; 3]);
        spec.texture("grid").unwrap().set_rgb1([0.9, 0.1, 0.33]).set_rgb2([0.2, 0.77, 0.4]);
        let mut compiled = spec.compile().unwrap();
        assert_eq!(edited.mat_rgba(), compiled.mat_rgba());
        assert_eq!(edited.light_diffuse(), compiled.light_diffuse());
        let grid = compiled.id(Object::Texture, "grid").unwrap();
        let (edited, compiled) = (edited.texture(grid), compiled.texture(grid));
        assert_eq!((edited.height, edited.width, edited.channels), (300, 300, 3));
        let pixels = edited.data.chunks_exact(3).zip(compiled.data.chunks_exact(3));
        let differing = pixels.enumerate().find(|(_, (a, b))| a != b);
        assert_eq!(differing.map(|(at, colors)| (at / 300, at % 300, colors)), None, "(row, column, colors)");
    }

    #[test]
    fn the_floor_decides_the_friction_of_contacts() {
        let model = cheetah().compile().unwrap();
        let floor = model.id(Object::Geom, "ground").unwrap();
        let foot = model.id(Object::Geom, "bfoot").unwrap();
        // (floor, foot): at 1 the file's own; below the foot's 0.4 both follow.
        for (value, expected) in [
            (1.0, [1.0, 0.4]),
            (0.5, [0.5, 0.4]),
            (0.1, [0.1, 0.1]),
            (f64::from(0.4f32), [0.4, 0.4]),
            (0.0, [LEAST_FRICTION; 2]),
        ] {
            let mut edited = model.clone();
            Effect::FloorFriction("ground").edit_model(&mut edited, &[value]).unwrap();
            assert_eq!([edited.geom_friction()[3 * floor], edited.geom_friction()[3 * foot]], expected);
        }
    }

    #[test]
    fn physics_do_not_see_the_textures() {
        let mut spec = cheetah();
        let full = spec.compile().unwrap();
        spec.shrink_textures();
        let small = spec.compile().unwrap();
        assert!(small.size_bytes() * 100 < full.size_bytes());
        assert_eq!(small.body_mass(), full.body_mass());
        assert_eq!(small.body_inertia(), full.body_inertia());
        assert_eq!(small.names(Object::Texture), full.names(Object::Texture));
        assert_eq!(small.mat_rgba(), full.mat_rgba());
    }

    #[test]
    fn a_name_that_does_not_exist_is_told() {
        let mut model = cheetah().compile().unwrap();
        let message = Effect::Light("lihgt").edit_model(&mut model, &[1.0]).unwrap_err().to_string();
        assert!(
            message.contains("no light `lihgt`") && message.contains("did you mean `light`?"),
            "{message}"
        );
        let message = Effect::Density(&["tail"]).edit_spec(&mut cheetah(), &[1.0]).unwrap_err().to_string();
        assert!(message.contains("no geom `tail`"), "{message}");
    }

    #[test]
    fn a_corrupt_model_names_the_file_and_the_reason() {
        let file = tempfile::Builder::new().suffix(".xml").tempfile().unwrap();
        std::fs::write(file.path(), "<mujoco><worldbody><geom type='teapot'/></worldbody></mujoco>").unwrap();
        let message = Spec::read(file.path()).err().unwrap().to_string();
        assert!(message.contains(file.path().to_str().unwrap()) && message.contains("teapot"), "{message}");
        std::fs::write(file.path(), "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>").unwrap();
        let message = Spec::read(file.path()).unwrap().compile().unwrap_err().to_string();
        assert!(message.contains("mass"), "{message}");
    }
}
