//! An image of packed pixels that spans can be filled in quickly. Not a frame: frames are `[H, W, 3]` bytes.

use crate::painter::Rgb;
use crate::rect::Rect;
use crate::region::Region;

/// A `[height, width]` image, one `u32` a pixel: red in the lowest byte, then green, blue, and a zero byte.
///
/// A packed pixel is filled and fetched as one word, which three bytes are not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<u32>,
}

impl Canvas {
    /// A black canvas.
    #[must_use]
    pub fn new(height: usize, width: usize) -> Self {
        Self { width, height, pixels: vec![0; height * width] }
    }

    /// Height in pixels.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Width in pixels.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// All pixels as rectangle.
    #[must_use]
    pub const fn bounds(&self) -> Rect {
        Rect::of_size(self.height, self.width)
    }

    /// The color of a pixel, or `None` outside.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<Rgb> {
        let inside = x < self.width && y < self.height;
        inside.then(|| unpack(self.pixels[y * self.width + x]))
    }

    /// The pixels as `[H, W, 3]` bytes.
    #[must_use]
    pub fn to_rgb(&self) -> Vec<u8> {
        self.pixels.iter().flat_map(|&pixel| unpack(pixel)).collect()
    }

    /// A canvas from `[H, W, 3]` bytes; `None` if there are more or fewer.
    #[must_use]
    pub fn from_rgb(height: usize, width: usize, rgb: &[u8]) -> Option<Self> {
        let (pixels, rest) = rgb.as_chunks::<3>();
        (rest.is_empty() && pixels.len() == height * width).then(|| Self {
            width,
            height,
            pixels: pixels.iter().map(|&pixel| pack(pixel)).collect(),
        })
    }

    pub(crate) fn row(&self, y: usize) -> &[u32] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// Copies pixels, which must lie inside, from a canvas of the same size.
    pub(crate) fn copy_region(&mut self, source: &Self, region: &Region) {
        for y in region.rows() {
            let columns = region.columns(y);
            let range = y * self.width + columns.start..y * self.width + columns.end;
            self.pixels[range.clone()].copy_from_slice(&source.pixels[range]);
        }
    }
}

pub(crate) const fn pack(color: Rgb) -> u32 {
    u32::from_le_bytes([color[0], color[1], color[2], 0])
}

pub(crate) const fn unpack(pixel: u32) -> Rgb {
    let [r, g, b, _] = pixel.to_le_bytes();
    [r, g, b]
}
