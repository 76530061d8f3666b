//! Images of tables: a column of structs of `bytes`, a PNG or JPEG file, and `path`, where that file is while LeRobot records. Without
//! bytes, the file is read if it is in the folder of the dataset. The other camera columns are videos.

use std::path::{Component, Path, PathBuf};

use parquet::data_type::ByteArray;
use serde_json::Value as Json;
use swm_data::error::{At as _, Result, invalid, missing, unsupported};
use swm_files::read_regular;
use swm_media::{jpeg, png};

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

/// The folder of images in that of a dataset.
const FOLDER: &str = "images";

/// The image of a row, as its table has it.
pub(super) enum Encoded {
    Bytes(ByteArray),
    /// The path of a file, mostly that on the machine of the recording.
    File(String),
    Nothing,
}

impl Encoded {
    /// Decodes it; `dataset` is the folder of the dataset.
    pub(super) fn decode(&self, dataset: &Path, shape: [usize; 3], out: &mut [u8]) -> Result<()> {
        match self {
            Self::Bytes(bytes) => decode(bytes.data(), shape, out),
            Self::File(path) => {
                let file = below(dataset, path).ok_or_else(|| {
                    missing(format!(
                        "the image is the file `{path}`, which is not in the folder of the dataset; copy the folder `{FOLDER}` of the \
                         recording into it, or embed the images in the tables (`embed_images` of LeRobot)"
                    ))
                })?;
                let bytes = read_regular(&file).at(file.display())?;
                decode(&bytes, shape, out).at(file.display())
            }
            Self::Nothing => Err(missing("the image has neither bytes nor a path (null)")),
        }
    }
}

/// The file of a path that another machine may have written: below the folder of the dataset, as it is or from the folder of images on.
/// No other file is read.
fn below(dataset: &Path, path: &str) -> Option<PathBuf> {
    let parts: Vec<&str> = path.split(['/', '\\']).collect();
    let from = |first: usize| {
        let relative: PathBuf = parts[first..].iter().collect();
        let stays = relative.components().all(|part| matches!(part, Component::Normal(_)));
        Some(dataset.join(relative)).filter(|file| stays && !path.contains('\0') && file.is_file())
    };
    let images = (0..parts.len()).rev().filter(|&at| parts[at] == FOLDER);
    [0].into_iter().chain(images).find_map(from)
}

/// Decodes a PNG or JPEG file.
fn decode(bytes: &[u8], shape: [usize; 3], out: &mut [u8]) -> Result<()> {
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
    fn only_files_below_the_folder_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let (outside, dataset) = (folder.path().join("images/0.png"), folder.path().join("dataset"));
        let inside = dataset.join("images/top/0.png");
        for file in [&outside, &inside] {
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, "").unwrap();
        }
        for path in ["images/top/0.png", "/data/images/a/images/top/0.png", "C:\\data\\images\\top\\0.png"] {
            assert_eq!(below(&dataset, path).as_ref(), Some(&inside), "{path}");
        }
        let absolute = outside.to_string_lossy().into_owned();
        for path in
            ["../images/0.png", "images/../../images/0.png", "images/1.png", "0.png", "", absolute.as_str()]
        {
            assert_eq!(below(&dataset, path), None, "{path}");
        }
    }

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
