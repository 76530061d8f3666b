//! Pictures of one environment: which model lends its textures, and which camera looks.

use swm_core::ImageSize;
use swm_fov::Fov;

use super::models::Models;
use super::settings::Renderer;
use crate::error::MujocoError;
use crate::ffi::Simulation;
use crate::ffi::gl::GlRenderer;
use crate::software::SoftwareRenderer;

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Picture {
    drawer: Drawer,
    /// The factors that the textures show.
    shows: Fov,
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
        let size = [size.height, size.width];
        let drawer = match renderer {
            Renderer::Software => Drawer::Software(Box::new(SoftwareRenderer::new(&model, camera, size)?)),
            Renderer::Gl => Drawer::Gl(Box::new(GlRenderer::new(&model, camera, size)?)),
        };
        Ok(Self { drawer, shows: fov, failure: None })
    }

    /// Shows these factors from now on.
    pub(super) fn prepare(&mut self, models: &Models, fov: &Fov) -> Result<(), MujocoError> {
        if self.shows != *fov {
            let model = models.textured_model(fov)?;
            match &mut self.drawer {
                Drawer::Software(renderer) => renderer.set_model(&model)?,
                Drawer::Gl(renderer) => renderer.set_model(&model)?,
            }
            self.shows = fov.clone();
        }
        Ok(())
    }

    /// Draws into `pixels`, `[height, width, 3]`; black, and a failure to [take](Picture::take_failure), where that
    /// fails.
    pub(super) fn draw(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
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
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.failure.take()
    }
}
