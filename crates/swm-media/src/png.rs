//! Images without loss.

use std::io::Cursor;
use std::path::Path;

use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits, Transformations};

use crate::clip::check_frame;
use crate::error::MediaError;
use crate::file;
use crate::format::Format;

/// The bytes of a PNG file of the image `rgb`, `[H, W, 3]`.
///
/// Compressed at the fast setting.
///
/// # Errors
///
/// An image of another length, without pixels, or beyond the 2^31 - 1 pixels a side of the format.
pub fn encode(height: usize, width: usize, rgb: &[u8]) -> Result<Vec<u8>, MediaError> {
    check_frame(rgb, height, width)?;
    encode_channels(height, width, 3, rgb)
}

/// As [`encode`], of an image `[H, W, C]` with C being 1 (gray) or 3 (RGB).
///
/// # Errors
///
/// As [`encode`], and another number of channels.
pub fn encode_channels(
    height: usize,
    width: usize,
    channels: usize,
    pixels: &[u8],
) -> Result<Vec<u8>, MediaError> {
    let colors = match channels {
        1 => ColorType::Grayscale,
        3 => ColorType::Rgb,
        _ => return Err(MediaError::encode(Format::Png, &format!("{channels} channels; use 1 or 3"))),
    };
    let [Ok(columns), Ok(rows)] = [width, height].map(u32::try_from) else {
        return Err(MediaError::FrameSize {
            format: Format::Png,
            height,
            width,
            min: 1,
            max: i32::MAX as usize,
            fix: "make a smaller image",
        });
    };
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(colors);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(pixels)?;
        writer.finish()
    });
    written.map_err(|error| MediaError::encode(Format::Png, &error))?;
    Ok(bytes)
}

/// Writes the image `rgb`, `[H, W, 3]`, to a PNG file.
///
/// # Errors
///
/// As [`encode`], and [`MediaError::Write`].
pub fn write(path: impl AsRef<Path>, height: usize, width: usize, rgb: &[u8]) -> Result<(), MediaError> {
    file::write(path.as_ref(), &encode(height, width, rgb)?)
}

/// Decodes a PNG file of 8 bits into `out`, `[H, W, C]` with C being 1 (gray) or 3 (RGB).
///
/// # Errors
///
/// [`MediaError::Decode`] for what is no PNG file, is damaged, or has another size or kind of colors.
pub fn decode_into(bytes: &[u8], shape: [usize; 3], out: &mut [u8]) -> Result<(), MediaError> {
    let wrong = |reason: String| MediaError::Decode { format: Format::Png, reason };
    let limits = Limits { bytes: out.len().saturating_mul(2).saturating_add(1 << 20) };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|error| wrong(error.to_string()))?;
    let found =
        [reader.info().height as usize, reader.info().width as usize, reader.output_color_type().0.samples()];
    if found != shape || reader.output_buffer_size() != Some(out.len()) {
        return Err(wrong(format!("it has the shape {found:?}, not {shape:?}")));
    }
    reader.next_frame(out).map_err(|error| wrong(error.to_string()))?;
    Ok(())
}
