//! Pictures of one environment: which model lends its textures, and which camera looks.

use swm_core::ImageSize;
use swm_fov::Fov;

use super::models::Models;
use crate::error::MujocoError;
use crate::ffi::Simulation;
use crate::ffi::gl::GlRenderer;

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Picture {
    renderer: GlRenderer,
    /// The factors that the textures show.
    shows: Fov,
    /// Why the last picture is black.
    failure: Option<MujocoError>,
}

impl Picture {
    pub(super) fn new(
        models: &Models,
        camera: usize,
        fov: Fov,
        size: ImageSize,
    ) -> Result<Self, MujocoError> {
        let model = models.textured_model(&fov)?;
        let renderer = GlRenderer::new(&model, camera, [size.height, size.width])?;
        Ok(Self { renderer, shows: fov, failure: None })
    }

    /// Shows these factors from now on.
    pub(super) fn prepare(&mut self, models: &Models, fov: &Fov) -> Result<(), MujocoError> {
        if self.shows != *fov {
            self.renderer.set_model(&models.textured_model(fov)?)?;
            self.shows = fov.clone();
        }
        Ok(())
    }

    /// Draws into `pixels`, `[height, width, 3]`; black, and a failure to [take](Picture::take_failure), where that
    /// fails.
    pub(super) fn draw(&mut self, sim: &mut Simulation, pixels: &mut [u8]) {
        if let Err(error) = self.renderer.draw(sim, pixels) {
            pixels.fill(0);
            self.failure = Some(error);
        }
    }

    /// Why a picture is black, once.
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.failure.take()
    }
}
