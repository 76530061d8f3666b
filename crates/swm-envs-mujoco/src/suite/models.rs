//! The models of one environment: shared where the factors are at their defaults, edited or compiled anew where not.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_fov::{Fov, FovSpace};

use super::domain::Domain;
use super::effect::Control;
use crate::assets;
use crate::error::MujocoError;
use crate::ffi::{Model, Spec};

/// How the model of an episode came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// All factors are at their defaults: one model for all environments of the process.
    Shared,
    /// A copy with other numbers in it.
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
    /// Without them, but with textures; compiled for the first picture.
    textured: Mutex<Option<Arc<Model>>>,
}

/// The description of a task's model, with the textures for pictures.
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

    /// The model for these factors with its textures, for pictures.
    pub(super) fn textured_model(&self, fov: &Fov) -> Result<Arc<Model>, MujocoError> {
        let compile = |fov| compile(&mut description(self.domain, self.task)?, &self.controls, fov);
        let mut model =
            if compile_values(&self.controls, fov) == compile_values(&self.controls, &self.defaults) {
                let mut textured = self.shared.textured.lock().unwrap_or_else(PoisonError::into_inner);
                match &*textured {
                    Some(model) => Arc::clone(model),
                    // Drawing a sky box into its texture takes most of a compilation.
                    None => Arc::clone(textured.insert(Arc::new(compile(&self.defaults)?))),
                }
            } else {
                Arc::new(compile(fov)?)
            };
        edit_in_place(&self.controls, fov, Arc::make_mut(&mut model))?;
        Ok(model)
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

/// The description without what only pictures need.
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
    fov.value(name).numbers(name).expect("factors are numbers")
}
