//! The image of an episode's goal.

use swm_core::{Dtype, Field, ImageSize, RowsMut};
use swm_mujoco::MujocoError;

/// The image of a goal in the column `goal`: rendered where it is written first, and kept while goal and look are the same.
pub(crate) struct GoalImage {
    column: usize,
    pixels: Vec<u8>,
    /// Whether it is of an earlier goal, or of another look.
    is_stale: bool,
}

impl GoalImage {
    /// With its column behind `fields`.
    pub(crate) fn new(size: ImageSize, fields: &mut Vec<Field>) -> Self {
        let field = Field::episode("goal", Dtype::U8, &size.shape());
        let pixels = vec![0; field.dim()];
        fields.push(field);
        Self { column: fields.len() - 1, pixels, is_stale: true }
    }

    /// Another goal, or another look: the next image is rendered anew.
    pub(crate) fn renew(this: &mut Option<Self>) {
        if let Some(goal) = this {
            goal.is_stale = true;
        }
    }

    /// Writes the image, which `render` renders where it is needed: it takes the simulation to the goal, and back.
    pub(crate) fn write(
        &mut self,
        out: &mut RowsMut<'_>,
        render: impl FnOnce(&mut [u8]) -> Result<(), MujocoError>,
    ) {
        if std::mem::take(&mut self.is_stale) && render(&mut self.pixels).is_err() {
            // The next step finds the simulation unusable, and its error is that of the episode.
            self.pixels.fill(0);
        }
        out.write(self.column, &self.pixels);
    }
}
