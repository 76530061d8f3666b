//! The sizes in play: the canvas that worlds are measured in, the reference's image, the frame that is asked for.

use crate::error::{RenderError, check_size};

/// Sizes of the stages of an image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Geometry {
    /// Side of the square canvas; world coordinates are in its pixels.
    pub canvas: usize,
    /// Side of the square image that the reference makes of the canvas, before any resize to the asked size.
    pub image: usize,
    /// Height of the frame.
    pub height: usize,
    /// Width of the frame.
    pub width: usize,
}

impl Geometry {
    /// The reference's canvas of 512 px and image of 224 px, for frames of `[height, width, 3]`.
    #[must_use]
    pub const fn new(height: usize, width: usize) -> Self {
        Self { canvas: 512, image: 224, height, width }
    }

    /// Bytes of a frame: `height * width * 3`.
    #[must_use]
    pub const fn frame_len(&self) -> usize {
        self.height * self.width * 3
    }

    pub(crate) fn check(&self) -> Result<(), RenderError> {
        check_size("a canvas", self.canvas, self.canvas)?;
        check_size("an image", self.image, self.image)?;
        check_size("a frame", self.height, self.width)
    }
}
