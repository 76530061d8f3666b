//! Pictures without loss.

use std::path::Path;

use png::{BitDepth, ColorType, Compression, Encoder};

use crate::clip::check_frame;
use crate::error::MediaError;
use crate::file;
use crate::format::Format;

/// The bytes of a PNG file of the picture `rgb`, `[H, W, 3]`.
///
/// Compressed at the fast setting.
///
/// # Errors
///
/// A picture of another length, without pixels, or beyond the 2^31 - 1 pixels a side of the format.
pub fn encode(height: usize, width: usize, rgb: &[u8]) -> Result<Vec<u8>, MediaError> {
    check_frame(rgb, height, width)?;
    let [Ok(columns), Ok(rows)] = [width, height].map(u32::try_from) else {
        return Err(MediaError::FrameSize {
            format: Format::Png,
            height,
            width,
            min: 1,
            max: i32::MAX as usize,
            way_out: "make a smaller picture",
        });
    };
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(rgb)?;
        writer.finish()
    });
    written.map_err(|error| MediaError::encode(Format::Png, &error))?;
    Ok(bytes)
}

/// Writes the picture `rgb`, `[H, W, 3]`, to a PNG file.
///
/// # Errors
///
/// As [`encode`], and [`MediaError::Write`].
pub fn write(path: impl AsRef<Path>, height: usize, width: usize, rgb: &[u8]) -> Result<(), MediaError> {
    file::write(path.as_ref(), &encode(height, width, rgb)?)
}
