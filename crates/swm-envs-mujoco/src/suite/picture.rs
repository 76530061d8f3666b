//! Pictures of one environment: which model lends its textures.

use swm_core::RowsMut;
use swm_fov::Fov;

use super::models::Models;
use crate::error::MujocoError;
use crate::ffi::Simulation;
use crate::views::{Pictures, Views};

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Picture {
    pictures: Pictures,
    /// The factors that the textures show.
    shows: Fov,
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
            self.pictures.set_model(&model)?;
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
