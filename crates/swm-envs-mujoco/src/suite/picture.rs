//! Pictures of one environment: which model lends its textures, and which camera looks.

use std::sync::Arc;

use swm_core::{ImageSize, RowsMut};
use swm_fov::Fov;
use swm_render::scene::Quality;

use super::models::Models;
use crate::error::MujocoError;
use crate::ffi::gl::GlRenderer;
use crate::ffi::{Model, Simulation};
use crate::software::SoftwareRenderer;
use crate::views::{Pictures, Renderer, Views};

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Picture {
    pictures: Pictures,
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
    pub(super) fn new(models: &Models, views: Views, fov: Fov) -> Result<Self, MujocoError> {
        let model = models.textured_model(&fov)?;
        Ok(Self { pictures: Pictures::new(views, &model)?, shows: fov })
    }

    /// Shows these factors from now on.
    pub(super) fn prepare(&mut self, models: &Models, fov: &Fov) -> Result<(), MujocoError> {
        if self.shows != *fov {
            let model = models.textured_model(fov)?;
            for canvas in self.pictures.canvases() {
                canvas.set_model(&model)?;
            }
            self.shows = fov.clone();
        }
        Ok(())
    }

    /// As [`Pictures::write`].
    pub(super) fn write(&mut self, sim: &mut Simulation, first: usize, out: &mut RowsMut<'_>) {
        self.pictures.write(sim, first, out);
    }

    /// As [`Pictures::renderer`].
    pub(super) fn renderer(&self) -> String {
        self.pictures.renderer()
    }

    /// As [`Pictures::take_failure`].
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.pictures.take_failure()
    }
}

impl Canvas {
    /// For pictures of simulations of models with the same objects as this one, which lends textures and meshes.
    pub(crate) fn new(
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

    /// Writes the depth of the picture that was drawn last, `[height, width]`, m; 0 where that fails.
    pub(crate) fn write_depth(&mut self, depth: &mut [f32]) {
        let written = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.depth_of_last(depth),
            Drawer::Gl(_) => Err(MujocoError::Scene),
        };
        if let Err(error) = written {
            depth.fill(0.0);
            self.failure = Some(error);
        }
    }

    /// Writes which geoms the picture that was drawn last shows, `[height, width]`; -1 where that fails.
    pub(crate) fn write_segmentation(&mut self, segments: &mut [i32]) {
        let written = match &mut self.drawer {
            Drawer::Software(renderer) => renderer.segmentation_of_last(segments),
            Drawer::Gl(_) => Err(MujocoError::Scene),
        };
        if let Err(error) = written {
            segments.fill(-1);
            self.failure = Some(error);
        }
    }

    /// Why a picture is black, once.
    pub(crate) fn take_failure(&mut self) -> Option<MujocoError> {
        self.failure.take()
    }
}
