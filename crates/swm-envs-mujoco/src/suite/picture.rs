//! Pictures of one environment: which model lends its textures, and which camera looks.

use std::sync::Arc;

use swm_core::ImageSize;
use swm_fov::Fov;

use super::models::Models;
use super::settings::Renderer;
use crate::error::MujocoError;
use crate::ffi::gl::GlRenderer;
use crate::ffi::{Model, Simulation};
use crate::software::SoftwareRenderer;

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Picture {
    canvas: Canvas,
    /// The factors that the textures show.
    shows: Fov,
}

/// What draws, and whether it did.
pub(crate) struct Canvas {
    drawer: Drawer,
    /// Why the last picture is black.
    failure: Option<MujocoError>,
}

enum Drawer {
    Software(Box<SoftwareRenderer>),
    Gl(Box<GlRenderer>),
}

impl Picture {
    pub(super) fn new(
        models: &Models,
        renderer: Renderer,
        camera: usize,
        fov: Fov,
        size: ImageSize,
    ) -> Result<Self, MujocoError> {
        let model = models.textured_model(&fov)?;
        Ok(Self { canvas: Canvas::new(&model, renderer, camera, size)?, shows: fov })
    }

    /// Shows these factors from now on.
    pub(super) fn prepare(&mut self, models: &Models, fov: &Fov) -> Result<(), MujocoError> {
        if self.shows != *fov {
            let model = models.textured_model(fov)?;
            self.canvas.set_model(&model)?;
            self.shows = fov.clone();
        }
        Ok(())
    }

    /// As [`Canvas::draw`].
    pub(super) fn draw(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
        self.canvas.draw(sim, pixels);
    }

    /// As [`Canvas::take_failure`].
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.canvas.take_failure()
    }
}

impl Canvas {
    /// For pictures of simulations of models with the same objects as this one, which lends textures and meshes.
    pub(crate) fn new(
        model: &Arc<Model>,
        renderer: Renderer,
        camera: usize,
        size: ImageSize,
    ) -> Result<Self, MujocoError> {
        let size = [size.height, size.width];
        let drawer = match renderer {
            Renderer::Software => Drawer::Software(Box::new(SoftwareRenderer::new(model, camera, size)?)),
            Renderer::Gl => Drawer::Gl(Box::new(GlRenderer::new(model, camera, size)?)),
        };
        Ok(Self { drawer, failure: None })
    }

    /// Takes textures and meshes from another model from now on.
    pub(crate) fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        match &mut self.drawer {
            Drawer::Software(renderer) => renderer.set_model(model),
            Drawer::Gl(renderer) => renderer.set_model(model),
        }
    }

    /// Shows `[height, width, 3]` pixels in place of a flat texture of `model`, which lends all others.
    pub(crate) fn set_texture(
        &mut self,
        model: &Arc<Model>,
        texture: usize,
        size: [usize; 2],
        pixels: &[u8],
    ) -> Result<(), MujocoError> {
        match &mut self.drawer {
            Drawer::Software(renderer) => renderer.set_texture(texture, size, pixels),
            Drawer::Gl(renderer) => {
                let mut edited = Model::clone(model);
                edited.texture(texture).data.copy_from_slice(pixels);
                renderer.set_model(&Arc::new(edited))
            }
        }
    }

    /// Draws into `pixels`, `[height, width, 3]`; black, and a failure to [take](Picture::take_failure), where that
    /// fails.
    pub(crate) fn draw(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
        let drawn = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.draw(sim, pixels),
            Drawer::Gl(renderer) => renderer.draw(sim, pixels),
        };
        if let Err(error) = drawn {
            pixels.fill(0);
            self.failure = Some(error);
        }
    }

    /// Why a picture is black, once.
    pub(crate) fn take_failure(&mut self) -> Option<MujocoError> {
        self.failure.take()
    }
}
