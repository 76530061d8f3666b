//! Images of one environment: which model lends its textures, and the colors of the floor.

use std::sync::Arc;

use swm_core::RowsMut;
use swm_fov::Fov;

use super::models::Models;
use crate::views::{CheckerColors, Images, Views};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Simulation};

/// Draws an environment's simulation, which runs on a model without textures.
pub(super) struct Image {
    images: Images,
    /// Lends textures.
    model: Arc<Model>,
    /// The floor's texture in other colors than the model's.
    floor: Option<(usize, CheckerColors)>,
    /// The factors that they show.
    shows: Fov,
}

impl Image {
    /// With the factors at their defaults.
    pub(super) fn new(models: &Models, views: Views, defaults: &Fov) -> Result<Self, MujocoError> {
        let model = models.textured_model(defaults)?;
        Ok(Self { images: Images::new(views, &model)?, model, floor: None, shows: defaults.clone() })
    }

    /// Shows these factors from now on.
    pub(super) fn prepare(&mut self, models: &Models, fov: &Fov) -> Result<(), MujocoError> {
        if self.shows == *fov {
            return Ok(());
        }
        let (model, floor) = (models.textured_model(fov)?, models.floor_colors(fov)?);
        let is_other = !Arc::ptr_eq(&model, &self.model);
        if is_other || (floor.is_none() && self.floor.is_some()) {
            self.images.set_model(&model)?;
        }
        if let Some((texture, colors)) = floor
            && (is_other || floor != self.floor)
        {
            self.images.recolor(&model, texture, &|at, color| colors.recolor(at, color))?;
        }
        (self.model, self.floor, self.shows) = (model, floor, fov.clone());
        Ok(())
    }

    /// As [`Images::write`].
    pub(super) fn write(&mut self, sim: &mut Simulation, first: usize, out: &mut RowsMut<'_>) {
        self.images.write(sim, first, out);
    }

    /// As [`Images::render`].
    pub(super) fn render(&mut self, sim: &mut Simulation, out: &mut [u8]) {
        self.images.render(sim, out);
    }

    /// As [`Images::renderer`].
    pub(super) fn renderer(&self) -> String {
        self.images.renderer()
    }

    /// As [`Images::take_failure`].
    pub(super) fn take_failure(&mut self) -> Option<MujocoError> {
        self.images.take_failure()
    }
}
