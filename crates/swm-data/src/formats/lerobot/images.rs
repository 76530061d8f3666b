//! Images that lie in the tables: a column of structs of `bytes`, a PNG or JPEG file, and `path`. Its other camera columns are
//! videos.

use serde_json::Value as Json;
use swm_media::{jpeg, png};

use super::table::Table;
use crate::error::{Result, invalid, missing, unsupported};

/// Above this side a shape is taken for damage.
const MAX_SIDE: u64 = 1 << 15;

/// The shape `[H, W, 3]` of the images of a feature, whose own has the channels first or last.
pub(super) fn shape(feature: &Json) -> Result<[usize; 3]> {
    let sizes = feature["shape"].as_array().ok_or(missing("the feature has no shape"))?;
    let sizes: Vec<u64> = sizes.iter().filter_map(Json::as_u64).filter(|&size| size <= MAX_SIDE).collect();
    let named_first =
        feature["names"].get(0).and_then(Json::as_str).is_some_and(|name| name.starts_with("channel"));
    let [height, width] = match sizes[..] {
        [3, height, width] if named_first || width != 3 => [height, width],
        [height, width, 3] => [height, width],
        _ => {
            return Err(unsupported(format!("its images have the shape {}, not 3 colors", feature["shape"])));
        }
    };
    match height > 0 && width > 0 {
        true => Ok([height as usize, width as usize, 3]),
        false => Err(invalid("its images are empty")),
    }
}

/// Whether the first image of a column can be decoded.
pub(super) fn check(table: &Table, name: &str, row: usize, shape: [usize; 3]) -> Result<()> {
    let images = table.images(name, row..row + 1)?;
    let first = images.first().ok_or(missing("it holds no image"))?;
    decode(first.data(), shape, &mut vec![0; shape.iter().product()])
}

/// Decodes a PNG or JPEG file.
pub(super) fn decode(bytes: &[u8], shape: [usize; 3], out: &mut [u8]) -> Result<()> {
    match bytes {
        [0xff, 0xd8, ..] => jpeg::decode_into(bytes, shape, out)?,
        [0x89, b'P', b'N', b'G', ..] => png::decode_into(bytes, shape, out)?,
        _ => return Err(unsupported("an image is neither PNG nor JPEG; store it as PNG")),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn channels_come_first_or_last() {
        let of = |sizes: &[u64], names: &[&str]| shape(&json!({"shape": sizes, "names": names})).ok();
        assert_eq!(of(&[48, 64, 3], &["height", "width", "channels"]), Some([48, 64, 3]));
        assert_eq!(of(&[3, 48, 64], &["channels", "height", "width"]), Some([48, 64, 3]));
        assert_eq!(of(&[3, 48, 64], &[]), Some([48, 64, 3]));
        assert_eq!(of(&[3, 48, 3], &["channel", "height", "width"]), Some([48, 3, 3]));
        assert_eq!(of(&[3, 48, 3], &["height", "width", "channel"]), Some([3, 48, 3]));
        for wrong in [&[48, 64, 1][..], &[48, 64], &[0, 64, 3], &[1 << 40, 64, 3], &[4, 48, 64]] {
            assert_eq!(of(wrong, &[]), None, "{wrong:?}");
        }
    }
}
