//! What a camera sees: shapes with places and colors, lights, the camera itself. No pixels.

use std::sync::Arc;

use super::bindings::*;
use super::guard::guarded;
use super::model::slice;
use super::{Library, Model, Simulation};
use crate::error::MujocoError;

/// A list of what is to be drawn (`mjvScene`), made from a simulation for one camera of its model.
pub struct Scene {
    library: &'static Library,
    /// Made for models with these sizes.
    model: Arc<Model>,
    raw: Box<mjvScene>,
    camera: mjvCamera,
    option: mjvOption,
    perturb: mjvPerturb,
}

// SAFETY: it owns its memory, and MuJoCo keeps no thread-bound state in it.
unsafe impl Send for Scene {}
// SAFETY: through `&Scene` it is only read.
unsafe impl Sync for Scene {}

/// Shapes that a scene has room for beside the model's own: contacts, frames and the like. `dm_control`'s number.
const ROOM: usize = 1000;

impl Scene {
    /// An empty scene for the model's camera of this index.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoCamera`], or there is no memory.
    pub fn new(model: Arc<Model>, camera: usize) -> Result<Self, MujocoError> {
        let library = model.library();
        let api = library.api();
        if camera >= model.ncam() {
            return Err(MujocoError::NoCamera { index: camera, count: model.ncam() });
        }
        let mut raw = Box::new(zeroed());
        let (mut chosen, mut option, mut perturb) = (zeroed(), zeroed(), zeroed());
        let room = (4 * (model.ngeom() + model.header().nsite as usize)).max(ROOM);
        guarded(|| {
            // SAFETY: each pointer leads to a structure of the type that the function fills, and the model is valid.
            unsafe {
                (api.mjv_defaultCamera)(&raw mut chosen);
                (api.mjv_defaultOption)(&raw mut option);
                (api.mjv_defaultPerturb)(&raw mut perturb);
                (api.mjv_defaultScene)(&raw mut *raw);
                (api.mjv_makeScene)(model.as_ptr(), &raw mut *raw, room as i32);
            }
        })?;
        (chosen.type_, chosen.fixedcamid) = (mjCAMERA_FIXED as i32, camera as i32);
        Ok(Self { library, model, raw, camera: chosen, option, perturb })
    }

    /// Takes up the simulation as it stands computed.
    ///
    /// Its model may differ in values from the one that the scene was made for, colors included.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Scene`]: the simulation has other objects.
    pub fn update(&mut self, sim: &mut Simulation) -> Result<(), MujocoError> {
        if !same_objects(self.model.header(), sim.model().header()) {
            return Err(MujocoError::Scene);
        }
        let api = self.library.api();
        let model = sim.model().as_ptr();
        guarded(|| {
            // SAFETY: model and data are valid and belong together; the scene has memory for the model's skins and
            // flexes, whose sizes were compared, and a limit for the rest, which MuJoCo keeps.
            unsafe {
                (api.mjv_updateScene)(
                    model,
                    sim.as_mut_ptr(),
                    &raw const self.option,
                    &raw const self.perturb,
                    &raw mut self.camera,
                    mjCAT_ALL as i32,
                    &raw mut *self.raw,
                );
            }
        })
    }

    /// How many shapes there are to draw.
    pub fn geom_count(&self) -> usize {
        self.raw.ngeom as usize
    }

    /// What there is to render, in MuJoCo's order.
    pub fn geoms(&self) -> &[mjvGeom] {
        // SAFETY: MuJoCo has filled `ngeom` of the geoms that it allocated, and they stay while the scene is lent.
        unsafe { slice(self.raw.geoms, self.raw.ngeom.into(), 1) }
    }

    /// The lights, the headlight first.
    pub fn lights(&self) -> &[mjvLight] {
        &self.raw.lights[..self.raw.nlight as usize]
    }

    /// The cameras of both eyes; they differ in place only.
    pub fn eyes(&self) -> &[mjvGLCamera; 2] {
        &self.raw.camera
    }

    pub(super) fn as_mut_ptr(&mut self) -> *mut mjvScene {
        &raw mut *self.raw
    }

    /// The model that it was made for, or a later one with the same objects.
    pub(super) fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Stands for another model from now on, which must have the same objects.
    pub(super) fn set_model(&mut self, model: Arc<Model>) {
        self.model = model;
    }
}

/// Whether both models have the same objects, so that indices of one mean the same in the other. Sizes of textures and
/// meshes may differ: a model for physics alone has tiny ones.
pub(super) fn same_objects(a: &mjModel, b: &mjModel) -> bool {
    let counts = |m: &mjModel| {
        [
            [m.nbody, m.njnt, m.ngeom, m.nsite, m.ncam, m.nlight, m.nmat, m.ntex],
            [m.nmesh, m.nhfield, m.nhfielddata, m.nskin, m.nskinvert, m.nskinface, m.nflex, m.nflexvert],
            [m.nflexedge, m.nflexelem, m.nflexelemdata, m.nflexshelldata, m.ntendon, m.nu, 0, 0],
        ]
    };
    counts(a) == counts(b)
}

/// A structure of C, for the function that fills it.
pub(super) fn zeroed<T: PlainC>() -> T {
    // SAFETY: all fields of these types are numbers, or pointers that may be null.
    unsafe { std::mem::zeroed() }
}

/// Structures of C whose fields may all be zero.
pub(super) trait PlainC {}

impl PlainC for mjvScene {}
impl PlainC for mjvCamera {}
impl PlainC for mjvOption {}
impl PlainC for mjvPerturb {}
impl PlainC for mjrContext {}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the scene is ours and is not used again.
        unsafe { (self.library.api().mjv_freeScene)(&raw mut *self.raw) };
    }
}
