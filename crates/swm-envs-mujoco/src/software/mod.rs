//! Images without OpenGL: what MuJoCo says there is to render, rendered by `swm-render`. How an image is made is not known
//! here.

mod store;
mod translate;

use std::sync::Arc;

use swm_render::Geometry;
use swm_render::scene::{Quality, Scene as Image, SceneRenderer};

use store::{Slot, Store};
use swm_mujoco::MujocoError;
use swm_mujoco::visuals::Looks;
use swm_mujoco::{Model, Scene, Simulation};
use translate::{camera, haze, instance, lamp};

/// Renders simulations of one model as one of its cameras sees them.
///
/// Textures and meshes come from the model that it was made with, and are shared by all renderers of it; places, sizes and
/// colors come from the simulation that is rendered, whose model may be one for physics with the textures left out.
pub struct SoftwareRenderer {
    model: Arc<Model>,
    looks: Looks,
    /// The renderer.
    store: Arc<Store>,
    /// The model's own, kept for other renderers of the model to find.
    shared: Arc<Store>,
    scene: Scene,
    image: Image,
    renderer: SceneRenderer,
}

impl SoftwareRenderer {
    /// A renderer for images of `height` × `width` pixels from the camera of this index.
    ///
    /// # Errors
    ///
    /// No such camera, a size that is 0 or too large, or meshes and textures that cannot be rendered.
    pub fn new(model: &Arc<Model>, camera: usize, size: [usize; 2]) -> Result<Self, MujocoError> {
        Self::with_quality(model, camera, size, Quality::default())
    }

    /// A renderer of better or quicker images.
    ///
    /// # Errors
    ///
    /// As of [`SoftwareRenderer::new`].
    pub fn with_quality(
        model: &Arc<Model>,
        camera: usize,
        [height, width]: [usize; 2],
        quality: Quality,
    ) -> Result<Self, MujocoError> {
        let geometry = Geometry::new(height, width);
        let store = Store::of(model)?;
        Ok(Self {
            looks: model.looks(),
            shared: Arc::clone(&store),
            store,
            scene: Scene::new(Arc::clone(model), camera)?,
            image: Image::default(),
            renderer: SceneRenderer::new(geometry, quality)?,
            model: Arc::clone(model),
        })
    }

    /// Takes textures and meshes from another model with the same objects.
    ///
    /// # Errors
    ///
    /// Its meshes or textures cannot be rendered.
    pub fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        self.shared = Store::of(model)?;
        self.store = Arc::clone(&self.shared);
        self.looks = model.looks();
        self.model = Arc::clone(model);
        Ok(())
    }

    /// Shows a texture of the model, which lends all others, in colors that depend on its own: row and column of a
    /// pixel, of a cube's in its face, and its color.
    pub fn recolor(&mut self, index: usize, recolor: impl Fn([usize; 2], [u8; 3]) -> [u8; 3]) {
        let Some(slot) = self.shared.slots.get(index) else { return };
        // What others show stays as it is.
        let mut own = Store::clone(&self.shared);
        match *slot {
            Slot::Flat(slot) => {
                own.assets.textures[slot] = Arc::new(own.assets.textures[slot].recolored(recolor));
            }
            Slot::Cube(slot) => own.assets.cubes[slot] = Arc::new(own.assets.cubes[slot].recolored(recolor)),
        }
        self.store = Arc::new(own);
    }

    /// Writes the image of the simulation as it stands computed, `[height, width, 3]`.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `pixels` has another length.
    pub fn render(&mut self, sim: &mut Simulation, pixels: &mut [u8]) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render(&self.image, &self.store.assets, pixels)?)
    }

    /// Writes what each pixel shows, `[height, width]`: the index of a geom, -2 - index of a site,
    /// the smallest number for other things, -1 for nothing.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `segments` has another length.
    pub fn render_segmentation(
        &mut self,
        sim: &mut Simulation,
        segments: &mut [i32],
    ) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render_segmentation(&self.image, &self.store.assets, segments)?)
    }

    /// Writes the distance of each pixel along the camera's axis, m, `[height, width]`.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `depth` has another length.
    pub fn render_depth(&mut self, sim: &mut Simulation, depth: &mut [f32]) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render_depth(&self.image, &self.store.assets, depth)?)
    }

    /// As [`SoftwareRenderer::render_segmentation`], of the image that was rendered last.
    ///
    /// # Errors
    ///
    /// `segments` has another length.
    pub fn segmentation_of_last(&mut self, segments: &mut [i32]) -> Result<(), MujocoError> {
        Ok(self.renderer.segmentation_of_last(&self.image, &self.store.assets, segments)?)
    }

    /// As [`SoftwareRenderer::render_depth`], of the image that was rendered last.
    ///
    /// # Errors
    ///
    /// `depth` has another length.
    pub fn depth_of_last(&mut self, depth: &mut [f32]) -> Result<(), MujocoError> {
        Ok(self.renderer.depth_of_last(&self.image, &self.store.assets, depth)?)
    }

    fn describe(&mut self, sim: &mut Simulation) -> Result<(), MujocoError> {
        self.scene.update(sim)?;
        let Self { model, looks, store, scene, image, .. } = self;
        let [left, right] = scene.eyes();
        image.camera = camera(left, right);
        image.sky = store.sky;
        image.lights.clear();
        image.lights.extend(scene.lights().iter().filter_map(|light| lamp(light, looks)));
        image.instances.clear();
        image.instances.extend(scene.geoms().iter().filter_map(|geom| instance(geom, model, store)));
        image.haze = scene.geoms().iter().find_map(|geom| haze(geom, looks, &image.camera));
        Ok(())
    }
}
