//! Frames of one size in a row. How they become a file stands in `save`.

use crate::error::MediaError;
use crate::format::Format;

/// A video in memory: `[T, H, W, 3]` u8 RGB frames and a frame rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    height: usize,
    width: usize,
    frames_per_second: f64,
    /// All frames, one after another: a multiple of `H * W * 3` bytes.
    pixels: Vec<u8>,
}

impl Clip {
    /// A clip without frames yet, for frames of `height` x `width` pixels.
    pub const fn new(height: usize, width: usize, frames_per_second: f64) -> Self {
        Self { height, width, frames_per_second, pixels: Vec::new() }
    }

    /// Appends a frame `[H, W, 3]`.
    ///
    /// # Errors
    ///
    /// [`MediaError::FrameLength`] for a frame of another size, or without pixels.
    pub fn push(&mut self, frame: &[u8]) -> Result<(), MediaError> {
        check_frame(frame, self.height, self.width)?;
        self.pixels.extend_from_slice(frame);
        Ok(())
    }

    /// The clip with every pixel repeated, by the least whole factor that makes the short side `min_side` pixels.
    ///
    /// For frames too small to look at. Frames that are large enough, or empty, stay as they are.
    #[must_use]
    pub fn upscaled(&self, min_side: usize) -> Self {
        let short = self.height.min(self.width);
        let factor = if short == 0 { 1 } else { min_side.div_ceil(short).max(1) };
        let mut pixels = Vec::with_capacity(self.pixels.len() * factor * factor);
        for row in self.pixels.chunks_exact((self.width * 3).max(1)) {
            let start = pixels.len();
            for pixel in row.chunks_exact(3) {
                for _ in 0..factor {
                    pixels.extend_from_slice(pixel);
                }
            }
            let end = pixels.len();
            for _ in 1..factor {
                pixels.extend_from_within(start..end);
            }
        }
        Self { height: self.height * factor, width: self.width * factor, pixels, ..*self }
    }

    /// The frames `[H, W, 3]`, first to last.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &[u8]> + DoubleEndedIterator {
        self.pixels.chunks_exact((self.height * self.width * 3).max(1))
    }

    /// Rows of a frame.
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Columns of a frame.
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Frames per second.
    pub const fn frames_per_second(&self) -> f64 {
        self.frames_per_second
    }

    /// The number of frames, T.
    pub fn len(&self) -> usize {
        self.frames().len()
    }

    /// Whether there is no frame.
    pub const fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }
}

/// What every video needs: a frame, a rate, and sides of `min` to `max` pixels.
pub(crate) fn check_video(
    format: Format,
    [height, width]: [usize; 2],
    frames: usize,
    frames_per_second: f64,
    [min, max]: [usize; 2],
    fix: &'static str,
) -> Result<(), MediaError> {
    if frames == 0 {
        return Err(MediaError::EmptyClip);
    }
    if !(frames_per_second.is_finite() && frames_per_second > 0.0) {
        return Err(MediaError::FrameRate { frames_per_second });
    }
    if height.min(width) < min || height.max(width) > max {
        return Err(MediaError::FrameSize { format, height, width, min, max, fix });
    }
    Ok(())
}

/// Refuses what is not `[H, W, 3]` with at least one pixel.
pub(crate) fn check_frame(frame: &[u8], height: usize, width: usize) -> Result<(), MediaError> {
    let expected = height.checked_mul(width).and_then(|pixels| pixels.checked_mul(3));
    if frame.is_empty() || expected != Some(frame.len()) {
        return Err(MediaError::FrameLength { height, width, found: frame.len() });
    }
    Ok(())
}
