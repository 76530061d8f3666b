//! Images that other programs keep as files of JPEG or PNG.

use swm_data::error::{Result, invalid, unsupported};
use swm_media::{MediaError, jpeg, png};

/// Pixels of an image, at most.
const MAX_PIXELS: usize = 1 << 28;
const JPEG: &[u8] = &[0xff, 0xd8];
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The shape of an image, with 1 color or 3: an alpha channel is none of them.
pub(super) fn shape(file: &[u8]) -> Result<[usize; 3]> {
    if file.starts_with(JPEG) {
        return Ok(jpeg::shape(file)?);
    }
    // A PNG file begins with its signature and the chunk IHDR: width, height, bits, kind of colors.
    let head: Option<&[u8; 26]> = file.first_chunk().filter(|head: &&[u8; 26]| head.starts_with(PNG));
    let head = head.ok_or_else(|| unsupported("its bytes are no images of JPEG or PNG"))?;
    let size = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let (height, width) = (size(20), size(16));
    match height.checked_mul(width) {
        Some(1..=MAX_PIXELS) => Ok([height, width, if matches!(head[25], 0 | 4) { 1 } else { 3 }]),
        _ => Err(invalid(format!("an image claims {height} × {width} pixels"))),
    }
}

/// Decodes an image into `out`, `[H, W, C]`. A PNG file of other channels is read as TensorFlow's `decode_png` does: gray becomes each color,
/// and alpha is left out.
///
/// # Errors
///
/// It is damaged; or, as what is not read, of another size.
pub(super) fn decode(file: &[u8], expected: [usize; 3], out: &mut [u8]) -> Result<()> {
    let decoded = match file.starts_with(JPEG) {
        true => jpeg::decode_into(file, expected, out),
        false => {
            png::decode_into(file, expected, out).or_else(|error| other_channels(file, expected, out, error))
        }
    };
    let Err(error) = decoded else { return Ok(()) };
    match shape(file) {
        Ok([height, width, _]) if [height, width] != expected[..2] => Err(unsupported(format!(
            "an image has {height} × {width} pixels, and those of the column {} × {}; make all of one size before they are stored",
            expected[0], expected[1]
        ))),
        _ => Err(error.into()),
    }
}

/// Decodes a PNG file that has other channels than are expected; `error` is of the attempt with these.
fn other_channels(
    file: &[u8],
    [height, width, colors]: [usize; 3],
    out: &mut [u8],
    error: MediaError,
) -> Result<(), MediaError> {
    let found = if colors == 3 { &[1, 2, 4][..] } else { &[2] };
    for &channels in found {
        let mut pixels = vec![0; height * width * channels];
        if png::decode_into(file, [height, width, channels], &mut pixels).is_ok() {
            for (pixel, out) in pixels.chunks_exact(channels).zip(out.chunks_exact_mut(colors)) {
                match channels {
                    4 => out.copy_from_slice(&pixel[..3]),
                    _ => out.fill(pixel[0]),
                }
            }
            return Ok(());
        }
    }
    Err(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_in_the_heads_of_files() {
        let file = png::encode(2, 3, &[7; 18]).unwrap();
        assert_eq!(shape(&file).unwrap(), [2, 3, 3]);
        assert_eq!(shape(&png::encode_channels(2, 3, 1, &[7; 6]).unwrap()).unwrap(), [2, 3, 1]);
        assert!(shape(&file[..20]).unwrap_err().is_unsupported());
        assert!(shape(b"GIF89a").unwrap_err().is_unsupported());
        let mut huge = file;
        huge[16..24].fill(0x7f);
        assert!(shape(&huge).unwrap_err().to_string().contains("claims 2139062143 × 2139062143"));
    }

    #[test]
    fn an_image_of_another_size_is_not_damaged() {
        for file in [png::encode(2, 3, &[7; 18]).unwrap(), jpeg::encode(2, 3, 3, &[7; 18], 90).unwrap()] {
            let mut out = [0; 27];
            let error = decode(&file, [3, 3, 3], &mut out).unwrap_err();
            assert!(error.is_unsupported(), "{error}");
            assert!(error.to_string().contains("has 2 × 3 pixels, and those of the column 3 × 3"), "{error}");
            assert!(!decode(&file[..40], [2, 3, 3], &mut out[..18]).unwrap_err().is_unsupported());
        }
    }
}
