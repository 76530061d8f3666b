//! The models of one environment: shared where the factors are at their defaults, edited or compiled anew where not.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_fov::{Fov, FovSpace};

use super::domain::Domain;
use super::effect::Control;
use crate::views::CheckerColors;
use swm_mujoco::MujocoError;
use swm_mujoco::assets;
use swm_mujoco::{Model, Object, Spec};

/// How the model of an episode came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// All factors are at their defaults: one model for all environments of the process.
    Shared,
    /// A copy with other values in it.
    Edited,
    /// Compiled for this episode's factors.
    Recompiled,
}

/// Gives the model for an assignment of factors.
pub(super) struct Models {
    domain: &'static Domain,
    task: &'static str,
    controls: Vec<Control>,
    defaults: Fov,
    shared: Arc<SharedModels>,
    /// Read when the first factor needs it.
    spec: Option<Spec>,
    /// The last recompiled model, and the values of the factors that it was compiled for.
    recompiled: Option<(Vec<f64>, Arc<Model>)>,
}

/// The models of a domain with all factors at their defaults.
struct SharedModels {
    /// Without the effects in place.
    plain: Arc<Model>,
    /// With them.
    complete: Arc<Model>,
    /// With them and with textures.
    textured: Mutex<Option<Arc<Model>>>,
}

/// The description of a task's model, with the textures for images.
///
/// # Errors
///
/// The file or the library is missing, or the domain cannot compose the task from it.
pub fn description(domain: &Domain, task: &str) -> Result<Spec, MujocoError> {
    let mut spec = Spec::read(&assets::suite_model(domain.model)?)?;
    (domain.compose)(&mut spec, task)?;
    Ok(spec)
}

impl Models {
    pub(super) fn new(
        domain: &'static Domain,
        task: &'static str,
        stock: bool,
    ) -> Result<(Self, FovSpace), MujocoError> {
        let controls = (domain.factors)(stock);
        let space = FovSpace::new(controls.iter().map(|control| control.factor.clone()).collect());
        let defaults = space.defaults();
        let shared = SharedModels::get(domain, task, stock, &controls, &defaults)?;
        let models = Self { domain, task, controls, defaults, shared, spec: None, recompiled: None };
        Ok((models, space))
    }

    /// The model with all factors at their defaults.
    pub(super) fn default_model(&self) -> Arc<Model> {
        Arc::clone(&self.shared.complete)
    }

    /// The model for these factors.
    pub(super) fn model(&mut self, fov: &Fov) -> Result<(Arc<Model>, Origin), MujocoError> {
        if fov.iter().eq(self.defaults.iter()) {
            return Ok((self.default_model(), Origin::Shared));
        }
        let compiled = compile_values(&self.controls, fov);
        let (mut model, origin) = if compiled == compile_values(&self.controls, &self.defaults) {
            (Arc::clone(&self.shared.plain), Origin::Edited)
        } else {
            (self.compiled_for(fov, compiled)?, Origin::Recompiled)
        };
        edit_in_place(&self.controls, fov, Arc::make_mut(&mut model))?;
        Ok((model, origin))
    }

    /// The model that lends images its textures for these factors. Everything else in an image is that of the
    /// simulation, so that nothing is compiled for it: of a model with textures, drawing the sky takes a quarter of a
    /// second. Nor is it copied for the floor, see [`Models::floor_colors`]. The factors are those of the last [`Models::model`], or the defaults.
    pub(super) fn textured_model(&self, fov: &Fov) -> Result<Arc<Model>, MujocoError> {
        let mut model = self.shared.textured(self)?;
        // Shadows and haze are sized by it.
        let extent_m = self.compiled(fov).extent_m();
        if model.extent_m() != extent_m {
            Arc::make_mut(&mut model).set_extent_m(extent_m);
        }
        Ok(model)
    }

    /// The texture of the floor, and the colors that these factors give it, where they are not those of
    /// [`Models::textured_model`].
    pub(super) fn floor_colors(&self, fov: &Fov) -> Result<Option<(usize, CheckerColors)>, MujocoError> {
        let is_other = |name: &str| fov.value(name) != self.defaults.value(name);
        let mut checkers = self.controls.iter().filter(|control| control.effect.texture().is_some());
        let Some(control) = checkers.find(|control| is_other(control.factor.name())) else { return Ok(None) };
        let (texture, name) = (control.effect.texture().unwrap_or_default(), control.factor.name());
        let texture = self.shared.complete.id(Object::Texture, texture)?;
        let colors = CheckerColors::new(&values(&self.defaults, name), &values(fov, name));
        // The suite marks edges, in the very color of a field.
        let [width, height, _] = self.shared.textured(self)?.texture_size(texture);
        Ok(Some((texture, colors.within_edge([height, width]))))
    }

    /// The physics for these factors, if they are the last or the defaults, before edits in place.
    fn compiled(&self, fov: &Fov) -> &Model {
        match &self.recompiled {
            Some((of, model)) if *of == compile_values(&self.controls, fov) => model,
            _ => &self.shared.plain,
        }
    }

    fn compiled_for(&mut self, fov: &Fov, values: Vec<f64>) -> Result<Arc<Model>, MujocoError> {
        if let Some((of, model)) = &self.recompiled
            && *of == values
        {
            return Ok(Arc::clone(model));
        }
        let spec = match &mut self.spec {
            Some(spec) => spec,
            empty => empty.insert(physics_description(self.domain, self.task)?),
        };
        let model = Arc::new(compile(spec, &self.controls, fov)?);
        self.recompiled = Some((values, Arc::clone(&model)));
        Ok(model)
    }
}

impl SharedModels {
    /// The model with textures; compiled for the first image.
    fn textured(&self, of: &Models) -> Result<Arc<Model>, MujocoError> {
        let mut textured = self.textured.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(model) = &*textured {
            return Ok(Arc::clone(model));
        }
        let mut model = compile(&mut description(of.domain, of.task)?, &of.controls, &of.defaults)?;
        edit_in_place(&of.controls, &of.defaults, &mut model)?;
        Ok(Arc::clone(textured.insert(Arc::new(model))))
    }

    /// The models of this process; compiled by whoever comes first, freed with the last environment.
    fn get(
        domain: &Domain,
        task: &'static str,
        stock: bool,
        controls: &[Control],
        defaults: &Fov,
    ) -> Result<Arc<Self>, MujocoError> {
        type Key = (&'static str, &'static str, bool);
        static KNOWN: Mutex<Vec<(Key, Weak<SharedModels>)>> = Mutex::new(Vec::new());
        let key = (domain.id, task, stock);
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, models)| models.strong_count() > 0);
        let found = known.iter().find(|(other, _)| *other == key);
        if let Some(models) = found.and_then(|(_, models)| models.upgrade()) {
            return Ok(models);
        }
        let plain = Arc::new(compile(&mut physics_description(domain, task)?, controls, defaults)?);
        let mut complete = Arc::clone(&plain);
        edit_in_place(controls, defaults, Arc::make_mut(&mut complete))?;
        let models = Arc::new(Self { plain, complete, textured: Mutex::default() });
        known.push((key, Arc::downgrade(&models)));
        Ok(models)
    }
}

/// The description without what only images need.
fn physics_description(domain: &Domain, task: &str) -> Result<Spec, MujocoError> {
    let mut spec = description(domain, task)?;
    spec.shrink_textures();
    Ok(spec)
}

/// Compiles the description for these factors; those with effects in place are left out.
fn compile(spec: &mut Spec, controls: &[Control], fov: &Fov) -> Result<Model, MujocoError> {
    for control in controls {
        let name = control.factor.name();
        control.effect.edit_spec(spec, &values(fov, name))?;
    }
    spec.compile()
}

/// Applies the effects in place.
///
/// # Errors
///
/// As of [`Effect::edit_model`](super::Effect::edit_model).
pub fn edit_in_place(controls: &[Control], fov: &Fov, model: &mut Model) -> Result<(), MujocoError> {
    for control in controls {
        control.effect.edit_model(model, &values(fov, control.factor.name()))?;
    }
    Ok(())
}

fn compile_values(controls: &[Control], fov: &Fov) -> Vec<f64> {
    let recompiling = controls.iter().filter(|control| control.effect.recompiles());
    recompiling.flat_map(|control| values(fov, control.factor.name())).collect()
}

fn values(fov: &Fov, name: &str) -> Vec<f64> {
    fov.value(name).to_f64s(name).expect("factors are numbers")
}

#[cfg(test)]
mod tests {
    use swm_core::seed::EpisodeSeed;
    use swm_core::{Episode, ResetOptions};

    use super::*;

    const DOMAINS: [&Domain; 12] = [
        &crate::acrobot::DOMAIN,
        &crate::ball_in_cup::DOMAIN,
        &crate::cartpole::DOMAIN,
        &crate::cheetah::DOMAIN,
        &crate::finger::DOMAIN,
        &crate::hopper::DOMAIN,
        &crate::humanoid::DOMAIN,
        &crate::manipulator::DOMAIN,
        &crate::pendulum::DOMAIN,
        &crate::quadruped::DOMAIN,
        &crate::reacher::DOMAIN,
        &crate::walker::DOMAIN,
    ];

    /// Of what images take from the model with textures, a compilation for the factors would change nothing.
    #[test]
    fn images_need_no_compilation() {
        for domain in DOMAINS {
            let (mut models, space) = Models::new(domain, domain.tasks[0].name, false).unwrap();
            let options = ResetOptions::default().vary(["all"]);
            let episode = Episode::new(EpisodeSeed::new(5), &options);
            let fov = space.sample(domain.id, &episode).unwrap();
            models.model(&fov).unwrap();
            let lent = models.textured_model(&fov).unwrap();
            let mut whole =
                compile(&mut description(domain, models.task).unwrap(), &models.controls, &fov).unwrap();
            edit_in_place(&models.controls, &fov, &mut whole).unwrap();
            assert_eq!(lent.extent_m(), whole.extent_m(), "{}", domain.id);
            assert_eq!(lent.texture_count(), whole.texture_count(), "{}", domain.id);
            for index in 0..whole.texture_count() {
                let mut pixels = lent.pixels(index).to_vec();
                if let Some((texture, colors)) = models.floor_colors(&fov).unwrap()
                    && texture == index
                {
                    assert_eq!(whole.texture_size(index)[2], 3, "{}: red, green, blue", domain.id);
                    let width = whole.texture_size(index)[0];
                    for (at, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                        let color = [pixel[0], pixel[1], pixel[2]];
                        pixel.copy_from_slice(&colors.recolor([at / width, at % width], color));
                    }
                }
                assert!(pixels == whole.pixels(index), "{}: texture {index}", domain.id);
            }
            assert!(lent.pixels(0).len() > 1000, "{}: textures are whole", domain.id);
        }
    }
}
