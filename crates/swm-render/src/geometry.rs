//! The sizes in play: the canvas that worlds are measured in, the reference's image, the frame that is asked for.
//!
//! The references draw in two ways: on a square canvas of which OpenCV makes an image, or, as Gymnasium's classic control
//! does, on a surface with y up, flipped at the end, which is the image.

use crate::error::{RenderError, check_size};

/// Sizes of the stages of an image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Geometry {
    /// Height and width of the canvas; world coordinates are in its pixels.
    pub canvas: [usize; 2],
    /// Height and width of the image that the reference makes of the canvas, before any resize to the asked size.
    pub image: [usize; 2],
    /// World coordinates have y up: the image is the canvas flipped.
    pub y_up: bool,
    /// Height of the frame.
    pub height: usize,
    /// Width of the frame.
    pub width: usize,
}

impl Geometry {
    /// The reference's canvas of 512 px and image of 224 px, for frames of `[height, width, 3]`.
    #[must_use]
    pub const fn new(height: usize, width: usize) -> Self {
        Self { canvas: [512; 2], image: [224; 2], y_up: false, height, width }
    }

    /// A surface of `canvas` = `[height, width]` px with y up, which is the reference's image, for frames of
    /// `[height, width, 3]`.
    #[must_use]
    pub const fn surface(canvas: [usize; 2], height: usize, width: usize) -> Self {
        Self { canvas, image: canvas, y_up: true, height, width }
    }

    /// Bytes of a frame: `height * width * 3`.
    #[must_use]
    pub const fn frame_len(&self) -> usize {
        self.height * self.width * 3
    }

    pub(crate) fn check(&self) -> Result<(), RenderError> {
        check_size("a canvas", self.canvas[0], self.canvas[1])?;
        check_size("an image", self.image[0], self.image[1])?;
        check_size("a frame", self.height, self.width)
    }
}
