//! The models of the tasks, each made once per process: a full one for images, and a light one for physics, of which every
//! environment edits a copy.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_fov::Fov;

use super::factors::{self, SCALE, scalar};
use super::task::Task;
use crate::suite::{Control, edit_in_place};
use swm_mujoco::MujocoError;
use swm_mujoco::assets::metaworld_model;
use swm_mujoco::{Model, Object, Simulation, Spec};

/// Anchor, relative position, relative quaternion and torque scale of the weld that pulls the hand. The twelfth value of MuJoCo
/// 3.17.0 stays: the original knows eleven.
const WELD: [f64; 11] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 5.0];
/// Radius and half height of the puck, m.
pub(super) const PUCK: f64 = 0.02;
/// Cameras that stand on their heads in the files.
const UPSIDE_DOWN: [&str; 4] = ["corner", "corner2", "corner3", "corner4"];

/// The models of a task.
pub(super) struct Shared {
    pub(super) full: Arc<Model>,
    pub(super) light: Arc<Model>,
}

/// The model for the last puck that had another size, and that scale.
pub(super) type Scaled = Option<(f64, Arc<Model>)>;

impl Shared {
    /// That of this process; compiled by whoever comes first, freed with the last environment.
    pub(super) fn get(task: &'static Task) -> Result<Arc<Self>, MujocoError> {
        static KNOWN: Mutex<Vec<(&str, Weak<Shared>)>> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, models)| models.strong_count() > 0);
        let found = known.iter().find(|(id, _)| *id == task.id);
        if let Some(models) = found.and_then(|(_, models)| models.upgrade()) {
            return Ok(models);
        }
        let mut full = Spec::read(&metaworld_model(task.file)?)?.compile()?;
        finish(&mut full)?;
        let light = Arc::new(light(task, &full, 1.0)?);
        let shared = Arc::new(Self { full: Arc::new(full), light });
        known.push((task.id, Arc::downgrade(&shared)));
        Ok(shared)
    }

    /// Gives the simulation a copy of the model with these factors; its state stays.
    pub(super) fn apply(
        &self,
        task: &'static Task,
        controls: &[Control],
        (fov, scaled): (&Fov, &mut Scaled),
        sim: &mut Simulation,
    ) -> Result<(), MujocoError> {
        let scale = if task.physics.is_puck { scalar(fov, SCALE) } else { 1.0 };
        if scale != 1.0 && scaled.as_ref().is_none_or(|(known, _)| *known != scale) {
            *scaled = Some((scale, Arc::new(light(task, &self.full, scale)?)));
        }
        let base =
            scaled.as_ref().filter(|(known, _)| *known == scale).map_or(&self.light, |(_, model)| model);
        let is_own = Arc::strong_count(sim.model()) == 1 && sim.model().geom_size() == base.geom_size();
        if is_own {
            sim.model_mut().copy_values(base);
        } else {
            sim.set_model(Arc::clone(base))?;
        }
        edit_in_place(controls, fov, sim.model_mut())?;
        factors::place_fixture(task, fov, sim.model_mut())
    }
}

/// The model for physics: without textures, and with tetrahedra for meshes that are only looked at.
fn light(task: &Task, full: &Model, scale: f64) -> Result<Model, MujocoError> {
    let mut spec = Spec::read(&metaworld_model(task.file)?)?;
    if scale != 1.0 {
        spec.geom("objGeom")?.set_size([PUCK * scale, PUCK * scale, 0.0]);
    }
    spec.shrink_meshes();
    let mut model = spec.compile()?;
    model.copy_mesh_places(full);
    model.set_extent_m(full.extent_m());
    finish(&mut model)?;
    Ok(model)
}

/// What the original sets in every model, and cameras the right way up: a half turn about their axes.
fn finish(model: &mut Model) -> Result<(), MujocoError> {
    model.eq_data_mut()[..WELD.len()].copy_from_slice(&WELD);
    for name in UPSIDE_DOWN {
        let camera = model.id(Object::Camera, name)?;
        let turn = &mut model.cam_quat_mut()[4 * camera..][..4];
        turn.copy_from_slice(&[-turn[3], turn[2], -turn[1], turn[0]]);
    }
    Ok(())
}
