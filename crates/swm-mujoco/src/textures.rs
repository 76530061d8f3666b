//! The textures of a compiled model.

use super::model::{Model, slice, slice_mut};

/// The pixels of one texture, `[height, width, channels]`.
#[derive(Debug)]
#[non_exhaustive]
pub struct Texture<'a> {
    /// Rows; of a cube texture, of all six sides.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Bytes per pixel.
    pub channels: usize,
    /// The bytes.
    pub data: &'a mut [u8],
}

impl Model {
    /// The pixels of a texture.
    pub fn texture(&mut self, texture: usize) -> Texture<'_> {
        let header = self.header();
        // SAFETY: these arrays hold `ntex` values, which the compiler made to lie within `tex_data`; the slices check
        // the index and the range; `&mut self` is the only access.
        unsafe {
            let of = |array: *mut i32| slice(array, header.ntex, 1)[texture] as usize;
            let (height, width) = (of(header.tex_height), of(header.tex_width));
            let channels = of(header.tex_nchannel);
            let start = slice(header.tex_adr, header.ntex, 1)[texture] as usize;
            let data = &mut slice_mut(header.tex_data, header.ntexdata, 1)[start..];
            Texture { height, width, channels, data: &mut data[..height * width * channels] }
        }
    }

    /// The pixels of a texture, to be read.
    pub fn pixels(&self, texture: usize) -> &[u8] {
        let header = self.header();
        // SAFETY: these arrays hold `ntex` values, which the compiler made to lie within `tex_data`; the slices check
        // the index and the range.
        unsafe {
            let of = |array: *mut i32| slice(array, header.ntex, 1)[texture] as usize;
            let len = of(header.tex_height) * of(header.tex_width) * of(header.tex_nchannel);
            let start = slice(header.tex_adr, header.ntex, 1)[texture] as usize;
            &slice(header.tex_data, header.ntexdata, 1)[start..start + len]
        }
    }

    /// Textures.
    pub fn texture_count(&self) -> usize {
        self.header().ntex as usize
    }

    /// Width, height and channels of a texture.
    pub fn texture_size(&self, texture: usize) -> [usize; 3] {
        let header = self.header();
        [header.tex_width, header.tex_height, header.tex_nchannel].map(|array| {
            // SAFETY: these arrays hold `ntex` values; the slice checks the index.
            unsafe { slice(array, header.ntex, 1)[texture] as usize }
        })
    }

    /// Whether a texture is flat, a cube, or the sky, as MuJoCo numbers them.
    pub fn texture_type(&self, texture: usize) -> i32 {
        let header = self.header();
        // SAFETY: the array holds `ntex` values; the slice checks the index.
        unsafe { slice(header.tex_type, header.ntex, 1)[texture] }
    }
}
