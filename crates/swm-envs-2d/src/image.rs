//! Images that are painted anew at every step, over what does not move in an episode.

use swm_core::ImageSize;
use swm_render::{Geometry, Painter, Renderer};

use crate::settings::Render;

/// What does not move in an episode.
pub(crate) trait Background {
    fn render_background(&self, painter: &mut dyn Painter);
}

/// What rendering needs.
pub(crate) struct Image<L> {
    renderer: Renderer,
    look: L,
    /// `[H, W, 3]`: the image of the goal.
    pub(crate) goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    pub(crate) goal_is_stale: bool,
}

impl<L: Background> Image<L> {
    pub(crate) fn new(size: ImageSize, style: Render, look: L) -> Result<Self, String> {
        let geometry = Geometry::new(size.height, size.width);
        let mut renderer = Renderer::new(style.into(), geometry).map_err(|error| error.to_string())?;
        renderer.set_background(|painter| look.render_background(painter));
        Ok(Self { renderer, look, goal: vec![0; geometry.frame_len()], goal_is_stale: true })
    }

    /// Takes the look of an episode, or of another state of one.
    pub(crate) fn set_look(&mut self, look: L) {
        self.renderer.set_background(|painter| look.render_background(painter));
        (self.look, self.goal_is_stale) = (look, true);
    }

    /// Writes a frame, `[H, W, 3]`: the background, and what `draw` paints over it.
    pub(crate) fn render(&mut self, out: &mut [u8], draw: impl FnOnce(&L, &mut dyn Painter)) {
        let look = &self.look;
        let rendered = self.renderer.render(out, |painter| draw(look, painter));
        rendered.expect("the pixel field has the renderer's size");
    }

    /// Renders the goal image.
    pub(crate) fn render_goal(&mut self, draw: impl FnOnce(&L, &mut dyn Painter)) {
        let mut goal = std::mem::take(&mut self.goal);
        self.render(&mut goal, draw);
        (self.goal, self.goal_is_stale) = (goal, false);
    }
}
