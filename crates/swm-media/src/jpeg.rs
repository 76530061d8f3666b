//! Images with loss, for datasets of single frames: gray or RGB.

use jpeg_encoder::{ColorType, Encoder};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::error::MediaError;
use crate::format::Format;

/// The longest side that is decoded, in pixels: what a forged header can make us allocate.
const MAX_SIDE: usize = 16_384;

/// The bytes of a JPEG file of the image `[H, W, C]`, C being 1 (gray) or 3 (RGB), at a quality of 1 to 100. Colors
/// keep their full resolution from quality 90 on.
///
/// # Errors
///
/// An image of another length, without pixels, or beyond 65,535 pixels a side.
pub fn encode(
    height: usize,
    width: usize,
    channels: usize,
    pixels: &[u8],
    quality: u8,
) -> Result<Vec<u8>, MediaError> {
    let colors = match channels {
        1 => ColorType::Luma,
        3 => ColorType::Rgb,
        _ => return Err(MediaError::encode(Format::Jpeg, &format!("{channels} channels; use 1 or 3"))),
    };
    if pixels.is_empty()
        || height.checked_mul(width).and_then(|n| n.checked_mul(channels)) != Some(pixels.len())
    {
        return Err(MediaError::FrameLength { height, width, found: pixels.len() });
    }
    let [Ok(columns), Ok(rows)] = [width, height].map(u16::try_from) else {
        let (min, max, fix) = (1, usize::from(u16::MAX), "make a smaller image");
        return Err(MediaError::FrameSize { format: Format::Jpeg, height, width, min, max, fix });
    };
    let mut bytes = Vec::new();
    let encoder = Encoder::new(&mut bytes, quality.clamp(1, 100));
    let written = encoder.encode(pixels, columns, rows, colors);
    written.map_err(|error| MediaError::encode(Format::Jpeg, &error))?;
    Ok(bytes)
}

/// Decodes a JPEG file into `out`, `[H, W, C]` with C being 1 or 3: gray becomes RGB and the other way round as asked.
///
/// # Errors
///
/// [`MediaError::Decode`] for what is no JPEG file, is damaged, or has another size.
pub fn decode_into(bytes: &[u8], shape: [usize; 3], out: &mut [u8]) -> Result<(), MediaError> {
    let mut decoder = decoder(bytes, if shape[2] == 1 { ColorSpace::Luma } else { ColorSpace::RGB });
    decoder.decode_headers().map_err(wrong)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    if [height, width] != shape[..2] {
        return Err(wrong(format!("it has {height} x {width} pixels, not {} x {}", shape[0], shape[1])));
    }
    if decoder.output_buffer_size() != Some(out.len()) {
        return Err(wrong(format!("it does not fill {} bytes", out.len())));
    }
    decoder.decode_into(out).map_err(wrong)
}

/// The shape `[H, W, C]` of a JPEG file.
///
/// # Errors
///
/// [`MediaError::Decode`] for what is no JPEG file.
pub fn shape(bytes: &[u8]) -> Result<[usize; 3], MediaError> {
    let mut decoder = decoder(bytes, ColorSpace::RGB);
    decoder.decode_headers().map_err(wrong)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let is_gray = decoder.input_colorspace() == Some(ColorSpace::Luma);
    Ok([height, width, if is_gray { 1 } else { 3 }])
}

fn decoder(bytes: &[u8], colors: ColorSpace) -> JpegDecoder<ZCursor<&[u8]>> {
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(colors)
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE);
    JpegDecoder::new_with_options(ZCursor::new(bytes), options)
}

#[expect(clippy::needless_pass_by_value, reason = "made for `map_err`, which hands over the error")]
fn wrong(error: impl ToString) -> MediaError {
    MediaError::Decode { format: Format::Jpeg, reason: error.to_string() }
}
