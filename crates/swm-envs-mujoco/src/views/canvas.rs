//! One camera's image, by whichever renderer is asked for. Which cameras there are is not known here.

use std::sync::Arc;

use swm_core::ImageSize;
use swm_render::scene::Quality;

use super::settings::Renderer;
use crate::software::SoftwareRenderer;
use swm_mujoco::MujocoError;
use swm_mujoco::gl::GlRenderer;
use swm_mujoco::{Model, Simulation};

/// What becomes of a texture's pixel: its row and column, and its color, lead to another color.
pub(crate) type Recolor<'a> = dyn Fn([usize; 2], [u8; 3]) -> [u8; 3] + 'a;

/// What draws, and whether it did.
pub(super) struct Canvas {
    drawer: Drawer,
    /// Why the last image is black.
    failure: Option<MujocoError>,
}

enum Drawer {
    Software(Box<SoftwareRenderer>),
    Gl(Box<GlRenderer>),
}

impl Canvas {
    /// For images of simulations of models with the same objects as this one, which lends textures and meshes.
    pub(super) fn new(
        model: &Arc<Model>,
        renderer: Renderer,
        camera: usize,
        size: ImageSize,
        quality: Quality,
    ) -> Result<Self, MujocoError> {
        let size = [size.height, size.width];
        let drawer = match renderer {
            Renderer::Software => {
                Drawer::Software(Box::new(SoftwareRenderer::with_quality(model, camera, size, quality)?))
            }
            Renderer::Gl => Drawer::Gl(Box::new(GlRenderer::new(model, camera, size)?)),
        };
        Ok(Self { drawer, failure: None })
    }

    /// Takes textures and meshes from another model from now on.
    pub(super) fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        match &mut self.drawer {
            Drawer::Software(renderer) => renderer.set_model(model),
            Drawer::Gl(renderer) => renderer.set_model(model),
        }
    }

    /// Shows a texture of `model`, which lends all others, in colors that depend on its own.
    pub(super) fn recolor(
        &mut self,
        model: &Arc<Model>,
        texture: usize,
        recolor: &Recolor<'_>,
    ) -> Result<(), MujocoError> {
        match &mut self.drawer {
            Drawer::Software(renderer) => {
                renderer.recolor(texture, recolor);
                Ok(())
            }
            Drawer::Gl(renderer) => {
                let mut edited = Model::clone(model);
                let texture = edited.texture(texture);
                let width = texture.width;
                for (index, pixel) in texture.data.chunks_exact_mut(texture.channels).enumerate() {
                    if let Some(pixel) = pixel.first_chunk_mut() {
                        *pixel = recolor([index / width, index % width], *pixel);
                    }
                }
                renderer.set_model(&Arc::new(edited))
            }
        }
    }

    /// Renders into `pixels`, `[height, width, 3]`; black, and a failure to [take](Canvas::take_failure), where that
    /// fails.
    pub(super) fn render(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
        let drawn = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.render(sim, pixels),
            Drawer::Gl(renderer) => renderer.render(sim, pixels),
        };
        if let Err(error) = drawn {
            pixels.fill(0);
            self.failure = Some(error);
        }
    }

    /// Writes the depth of the image that was rendered last, `[height, width]`, m; 0 where that fails.
    pub(super) fn write_depth(&mut self, depth: &mut [f32]) {
        let written = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.depth_of_last(depth),
            Drawer::Gl(_) => Err(MujocoError::Scene),
        };
        if let Err(error) = written {
            depth.fill(0.0);
            self.failure = Some(error);
        }
    }

    /// Writes which geoms the image that was rendered last shows, `[height, width]`; -1 where that fails.
    pub(super) fn write_segmentation(&mut self, segments: &mut [i32]) {
        let written = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.segmentation_of_last(segments),
            Drawer::Gl(_) => Err(MujocoError::Scene),
        };
        if let Err(error) = written {
            segments.fill(-1);
            self.failure = Some(error);
        }
    }

    /// Why an image is black, once.
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.failure.take()
    }
}
