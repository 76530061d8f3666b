//! The models of a table: a full one for images and a light one for physics, each made once per process, and an own
//! copy of the light one for every environment.
//!
//! The full model takes 63 MB, nearly all of it meshes and the sky. The light one has tetrahedra for the meshes that are
//! only looked at, and is equal in every array that the simulation reads. An own copy, once made, is kept: an episode's
//! colors are written into it in microseconds.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_fov::Fov;

use super::compose::{description, finish};
use super::factors::{self, factor_values};
use super::layout::{HALF_SIZE, Kind};
use crate::suite::{Control, edit_in_place};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Simulation, Spec};

/// Gives the models for an assignment of factors.
pub(super) struct Models {
    kind: Kind,
    controls: Vec<Control>,
    shared: Arc<Shared>,
    /// Compiled for other sizes.
    resized: Option<Resized>,
}

/// The model for sizes that are not the default ones.
struct Resized {
    spec: Spec,
    values: Vec<f64>,
    model: Arc<Model>,
}

/// The models of this process.
struct Shared {
    /// For physics, with the default sizes and colors.
    light: Arc<Model>,
    /// With all meshes and textures.
    full: Arc<Model>,
}

impl Models {
    pub(super) fn new(kind: Kind, transparent: bool, controls: Vec<Control>) -> Result<Self, MujocoError> {
        Ok(Self { kind, controls, shared: Shared::get(kind, transparent)?, resized: None })
    }

    /// The model for physics with all factors at their defaults.
    pub(super) fn light(&self) -> Arc<Model> {
        Arc::clone(&self.shared.light)
    }

    /// The model with all meshes and textures, for images.
    pub(super) fn full(&self) -> Arc<Model> {
        Arc::clone(&self.shared.full)
    }

    /// Gives the simulation the model for these factors. Its state stays only where nothing but values differs.
    pub(super) fn apply(&mut self, fov: &Fov, sim: &mut Simulation) -> Result<(), MujocoError> {
        let values = self.recompiling_values(fov);
        let base = self.base(fov, &values)?;
        if self.is_own_copy_of(sim, &base) {
            sim.model_mut().copy_values(&base);
        } else {
            sim.set_model(base)?;
        }
        edit_in_place(&self.controls, fov, sim.model_mut())
    }

    /// Whether the simulation has a copy that it can edit, with the sizes of `base`.
    fn is_own_copy_of(&self, sim: &Simulation, base: &Model) -> bool {
        let own = sim.model();
        Arc::strong_count(own) == 1 && own.body_mass() == base.body_mass()
    }

    fn base(&mut self, fov: &Fov, values: &[f64]) -> Result<Arc<Model>, MujocoError> {
        if values.iter().all(|value| *value == HALF_SIZE) {
            return Ok(self.light());
        }
        let resized = match &mut self.resized {
            Some(resized) => resized,
            empty => {
                let mut spec = description(self.kind)?;
                spec.shrink_meshes();
                empty.insert(Resized { spec, values: Vec::new(), model: Arc::clone(&self.shared.light) })
            }
        };
        if resized.values != values {
            for control in &self.controls {
                control.effect.edit_spec(&mut resized.spec, &factor_values(fov, control.factor.name()))?;
            }
            let mut model = resized.spec.compile()?;
            let light = &self.shared.light;
            model.copy_mesh_places(light);
            model.search_trees_for_meshes_only();
            model.mat_rgba_mut().copy_from_slice(light.mat_rgba());
            model.actuator_gainprm_mut().copy_from_slice(light.actuator_gainprm());
            model.actuator_biasprm_mut().copy_from_slice(light.actuator_biasprm());
            (resized.values, resized.model) = (values.to_vec(), Arc::new(model));
        }
        Ok(Arc::clone(&resized.model))
    }

    fn recompiling_values(&self, fov: &Fov) -> Vec<f64> {
        let recompiling = self.controls.iter().filter(|control| control.effect.recompiles());
        recompiling.flat_map(|control| factor_values(fov, control.factor.name())).collect()
    }
}

impl Shared {
    /// The models of this process; compiled by whoever comes first, freed with the last environment.
    fn get(kind: Kind, transparent: bool) -> Result<Arc<Self>, MujocoError> {
        type Key = (Kind, bool);
        static KNOWN: Mutex<Vec<(Key, Weak<Shared>)>> = Mutex::new(Vec::new());
        let key = (kind, transparent);
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, models)| models.strong_count() > 0);
        let found = known.iter().find(|(other, _)| *other == key);
        if let Some(models) = found.and_then(|(_, models)| models.upgrade()) {
            return Ok(models);
        }
        let models = Arc::new(Self::new(kind, transparent)?);
        known.push((key, Arc::downgrade(&models)));
        Ok(models)
    }

    fn new(kind: Kind, transparent: bool) -> Result<Self, MujocoError> {
        let mut full = description(kind)?.compile()?;
        finish(&mut full, transparent)?;
        let mut spec = description(kind)?;
        factors::set_sizes(&mut spec, &vec![HALF_SIZE; kind.cubes()])?;
        spec.shrink_meshes();
        let mut light = spec.compile()?;
        light.copy_mesh_places(&full);
        finish(&mut light, transparent)?;
        light.search_trees_for_meshes_only();
        Ok(Self { light: Arc::new(light), full: Arc::new(full) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorded_model::assert_is_recorded;

    #[test]
    fn composed_models_equal_the_references_in_every_array() {
        for (kind, file) in [
            (Kind::Cubes(1), "cube-single"),
            (Kind::Cubes(2), "cube-double"),
            (Kind::Cubes(4), "cube-quadruple"),
            (Kind::Scene, "scene"),
        ] {
            let mut model = description(kind).unwrap().compile().unwrap();
            finish(&mut model, true).unwrap();
            assert_is_recorded(&model, file);
        }
    }

    #[test]
    fn the_light_model_simulates_as_the_full_one() {
        for kind in [Kind::Cubes(1), Kind::Scene] {
            let shared = Shared::get(kind, true).unwrap();
            assert!(5 * shared.light.size_bytes() < 2 * shared.full.size_bytes());
            let run = |model: &Arc<Model>| {
                let mut sim = Simulation::new(Arc::clone(model)).unwrap();
                sim.reset();
                sim.qpos_mut()[..6].copy_from_slice(&super::super::arm::HOME);
                sim.forward().unwrap();
                let mut kept = Vec::new();
                for step in 0..20 {
                    let swing = f64::from(step % 7) / 7.0 - 0.5;
                    for (ctrl, home) in sim.ctrl_mut().iter_mut().zip(super::super::arm::HOME) {
                        *ctrl = home + swing;
                    }
                    sim.ctrl_mut()[6] = f64::from(step) * 12.0;
                    sim.advance(25, &mut kept).unwrap();
                }
                sim.qpos().to_vec()
            };
            let mut spec = description(kind).unwrap();
            factors::set_sizes(&mut spec, &[HALF_SIZE]).unwrap();
            let mut full = spec.compile().unwrap();
            finish(&mut full, true).unwrap();
            assert_eq!(run(&Arc::new(full)), run(&shared.light), "{kind:?}");
        }
    }
}
