//! Drawing a scene with MuJoCo's renderer, and reading the pixels.

use std::sync::{Arc, Mutex, PoisonError};

use super::GlContext;
use crate::bindings::*;
use crate::error::MujocoError;
use crate::guard::guarded;
use crate::scene::{same_objects, zeroed};
use crate::{Library, Model, Scene, Simulation};

/// Renders simulations of one model as one of its cameras sees them.
///
/// Textures, meshes and the quality of light come from the model that it was made with; places, sizes and colors from
/// the simulation that is rendered, whose model may be one for physics with the textures left out.
pub struct GlRenderer {
    library: &'static Library,
    gl: GlContext,
    /// What lies in the memory of the graphics card.
    resources: Box<mjrContext>,
    scene: Scene,
    viewport: mjrRect,
    /// Rows from the bottom to the top.
    upside_down: Vec<u8>,
}

// SAFETY: it owns its memory; the names of textures and buffers in it mean something in its own context alone, which
// moves with it.
unsafe impl Send for GlRenderer {}
// SAFETY: `&GlRenderer` gives access to nothing but the name of the driver.
unsafe impl Sync for GlRenderer {}

/// Held while resources are made or freed: MuJoCo counts contexts in a plain variable.
static COUNTING: Mutex<()> = Mutex::new(());

impl GlRenderer {
    /// A renderer for images of `height` × `width` pixels from the camera of this index.
    ///
    /// # Errors
    ///
    /// No OpenGL, or no such camera.
    pub fn new(model: &Arc<Model>, camera: usize, [height, width]: [usize; 2]) -> Result<Self, MujocoError> {
        let library = model.library();
        let side = |pixels: usize| i32::try_from(pixels).unwrap_or(i32::MAX);
        let mut renderer = Self {
            library,
            gl: GlContext::new()?,
            resources: Box::new(zeroed()),
            scene: Scene::new(Arc::clone(model), camera)?,
            viewport: mjrRect { left: 0, bottom: 0, width: side(width), height: side(height) },
            upside_down: vec![0; height * width * 3],
        };
        // SAFETY: it leads to a structure of the type that the function fills.
        unsafe { (library.api().mjr_defaultContext)(&raw mut *renderer.resources) };
        renderer.upload_all(model)?;
        Ok(renderer)
    }

    /// Takes textures, shapes and the quality of light from another model with the same objects.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Scene`]: other objects; or OpenGL failed.
    pub fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        let (old, new) = (self.scene.model(), model);
        if Arc::ptr_eq(old, new) {
            return Ok(());
        }
        if !same_objects(old.header(), new.header()) {
            return Err(MujocoError::Scene);
        }
        if same_shapes(old, new) {
            let changed: Vec<usize> =
                (0..new.texture_count()).filter(|&index| old.pixels(index) != new.pixels(index)).collect();
            self.upload_textures(model, &changed)?;
        } else {
            self.upload_all(model)?;
        }
        self.scene.set_model(Arc::clone(model));
        Ok(())
    }

    fn upload_textures(&mut self, model: &Model, textures: &[usize]) -> Result<(), MujocoError> {
        let Self { library, gl, resources, .. } = self;
        if textures.is_empty() {
            return Ok(());
        }
        gl.with_current(|| {
            guarded(|| {
                for index in textures {
                    // SAFETY: the context is current, and model and resources have a texture of this index.
                    unsafe {
                        (library.api().mjr_uploadTexture)(
                            model.as_ptr(),
                            &raw const **resources,
                            *index as i32,
                        );
                    }
                }
            })
        })?
    }

    fn upload_all(&mut self, model: &Model) -> Result<(), MujocoError> {
        let Self { library, gl, resources, viewport, .. } = self;
        let api = library.api();
        // SAFETY: the header is plain data, and the copy lives no longer than the model that its pointers lead into.
        let mut sized = unsafe { std::ptr::read(model.as_ptr()) };
        (sized.vis.global.offwidth, sized.vis.global.offheight) = (viewport.width, viewport.height);
        let _lock = COUNTING.lock().unwrap_or_else(PoisonError::into_inner);
        gl.with_current(|| {
            // SAFETY: the context is current, OpenGL is visible to MuJoCo, and what the resources held before is freed
            // by the function itself.
            guarded(|| unsafe {
                (api.mjr_makeContext)(&raw const sized, &raw mut **resources, mjFONTSCALE_100 as i32);
                (api.mjr_setBuffer)(mjFB_OFFSCREEN as i32, &raw mut **resources);
            })
        })?
    }

    /// Renders the simulation as it stands computed into `pixels`: `[height, width, 3]`, red, green and blue.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Scene`]: a simulation of another model; or OpenGL failed.
    ///
    /// # Panics
    ///
    /// If `pixels` has another length, a mistake of the caller.
    pub fn render(&mut self, sim: &mut Simulation, pixels: &mut [u8]) -> Result<(), MujocoError> {
        assert_eq!(pixels.len(), self.upside_down.len(), "an image of another size");
        self.scene.update(sim)?;
        let Self { library, gl, resources, scene, viewport, upside_down } = self;
        let api = library.api();
        gl.with_current(|| {
            // SAFETY: the context is current; the scene's objects are those of the resources; the buffer has room for
            // the viewport's pixels, and MuJoCo packs rows without gaps.
            guarded(|| unsafe {
                (api.mjr_setBuffer)(mjFB_OFFSCREEN as i32, &raw mut **resources);
                (api.mjr_render)(*viewport, scene.as_mut_ptr(), &raw const **resources);
                let depth = std::ptr::null_mut();
                (api.mjr_readPixels)(upside_down.as_mut_ptr(), depth, *viewport, &raw const **resources);
            })
        })??;
        let row = 3 * viewport.width as usize;
        for (target, source) in pixels.chunks_exact_mut(row).zip(upside_down.chunks_exact(row).rev()) {
            target.copy_from_slice(source);
        }
        Ok(())
    }

    /// What draws: `EGL` or `OSMesa`.
    pub fn driver_name(&self) -> &'static str {
        self.gl.driver_name()
    }
}

/// Whether both models have equal shapes, so that the card's memory holds the right ones already. Meshes and the like are
/// not compared: models with them count as different.
fn same_shapes(a: &Model, b: &Model) -> bool {
    let has_data = |m: &mjModel| m.nmesh + m.nhfield + m.nskin + m.nflex > 0;
    !has_data(a.header())
        && a.geom_types() == b.geom_types()
        && a.geom_size() == b.geom_size()
        && a.extent_m() == b.extent_m()
}

impl Drop for GlRenderer {
    fn drop(&mut self) {
        let Self { library, gl, resources, .. } = self;
        let _lock = COUNTING.lock().unwrap_or_else(PoisonError::into_inner);
        // Where the context cannot be made current, its resources go with it.
        let _ = gl.with_current(|| {
            // SAFETY: the context is current, and the resources are not used again.
            guarded(|| unsafe { (library.api().mjr_freeContext)(&raw mut **resources) })
        });
    }
}
