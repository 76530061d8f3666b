//! One renderer for both styles, so that an environment holds one value and asks nothing.

use crate::error::RenderError;
use crate::exact::ExactRenderer;
use crate::fast::FastRenderer;
use crate::geometry::Geometry;
use crate::painter::{Painter, Rgb};

/// How frames are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Style {
    /// As the reference draws them, to the byte.
    #[default]
    Exact,
    /// At the asked size, with analytic coverage.
    Fast,
}

/// Draws frames of `[H, W, 3]` bytes in either style. See the crate's example.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Renderer {
    /// [`Style::Exact`].
    Exact(Box<ExactRenderer>),
    /// [`Style::Fast`].
    Fast(Box<FastRenderer>),
}

impl Renderer {
    /// Allocates everything that frames of this geometry need.
    ///
    /// # Errors
    /// If a side is zero or above 4096.
    pub fn new(style: Style, geometry: Geometry) -> Result<Self, RenderError> {
        match style {
            Style::Exact => ExactRenderer::new(geometry).map(|renderer| Self::Exact(Box::new(renderer))),
            Style::Fast => FastRenderer::new(geometry).map(|renderer| Self::Fast(Box::new(renderer))),
        }
    }

    /// The sizes.
    #[must_use]
    pub fn geometry(&self) -> Geometry {
        match self {
            Self::Exact(renderer) => renderer.geometry(),
            Self::Fast(renderer) => renderer.geometry(),
        }
    }

    /// Replaces colors in the finished drawing from now on, in order: `(old, new)`. On a [`Geometry::surface`]; elsewhere
    /// the exact style has no such step. Pixels of exactly the old color change; in the fast style, everything that was
    /// drawn in it. To be called before [`Self::set_background`].
    pub fn set_palette(&mut self, swaps: &[(Rgb, Rgb)]) {
        match self {
            Self::Exact(renderer) => renderer.set_palette(swaps),
            Self::Fast(renderer) => renderer.set_palette(swaps),
        }
    }

    /// Draws what lies under every frame from now on, once: typically at the start of an episode.
    ///
    /// An equal background costs nothing; a different one makes the next frame a full redraw.
    pub fn set_background(&mut self, draw: impl FnOnce(&mut dyn Painter)) {
        match self {
            Self::Exact(renderer) => renderer.set_background(draw),
            Self::Fast(renderer) => renderer.set_background(draw),
        }
    }

    /// Draws a frame over the background and writes all of it to `out`, `[H, W, 3]`.
    ///
    /// `draw` paints everything that is not background, every time; primitives equal to those of the last frame at the
    /// same place of the order are recognized and not drawn again. The bytes depend on the background and this drawing
    /// alone.
    ///
    /// # Errors
    /// If `out` has the wrong length; nothing is drawn then.
    pub fn render(&mut self, out: &mut [u8], draw: impl FnOnce(&mut dyn Painter)) -> Result<(), RenderError> {
        match self {
            Self::Exact(renderer) => renderer.render(out, draw),
            Self::Fast(renderer) => renderer.render(out, draw),
        }
    }
}
