//! Images that are painted anew at every step, over what does not move in an episode.

use swm_core::ImageSize;
use swm_fov::SceneError;
use swm_render::{Geometry, Painter, Renderer};

use crate::settings::Render;

/// What does not move in an episode.
pub trait Background {
    fn render_background(&self, painter: &mut dyn Painter);
}

/// What renders images.
pub struct Canvas<L> {
    renderer: Renderer,
    /// That of the episode; `None` before the first.
    look: Option<L>,
}

impl<L: Background> Canvas<L> {
    pub(crate) fn new(size: ImageSize, style: Render) -> Result<Self, SceneError> {
        let renderer = Renderer::new(style.into(), Geometry::new(size.height, size.width));
        Ok(Self { renderer: renderer.map_err(|error| error.to_string())?, look: None })
    }

    /// Takes the look of an episode, or of another state of one.
    pub(crate) fn set_look(&mut self, look: L) {
        self.renderer.set_background(|painter| look.render_background(painter));
        self.look = Some(look);
    }

    /// Writes a frame, `[H, W, 3]`: the background, and what `draw` paints over it.
    pub(crate) fn render(&mut self, out: &mut [u8], draw: impl FnOnce(&L, &mut dyn Painter)) {
        let look = self.look.as_ref().expect("environments set the look when they are made");
        let rendered = self.renderer.render(out, |painter| draw(look, painter));
        rendered.expect("the pixel field has the renderer's size");
    }
}
