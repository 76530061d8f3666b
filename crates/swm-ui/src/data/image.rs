//! Images and videos of episodes: as they were recorded, or rendered by replaying the episode, with other factors too.

use std::collections::BTreeMap;
use std::sync::PoisonError;

use serde_json::Value as Json;
use swm_core::{Dtype, ImageSize, Registry, SliceMut, Value};
use swm_data::{Dataset, RenderOptions, Rendered, Steps};
use swm_media::{Clip, Format, MediaError, png};

use super::Image;
use super::opened::Opened;
use crate::error::Refusal;

/// The side of rendered images.
const MAX_SIDE: usize = 512;
/// Bytes of the frames of a video.
pub(crate) const MAX_VIDEO: usize = 600 << 20;
/// As `swm preview` has it.
const FRAMES_PER_SECOND: f64 = 10.0;

/// One image as PNG.
pub(super) fn still(opened: &Opened, registry: &Registry, asked: &Image) -> Result<Vec<u8>, Refusal> {
    with_images(opened, registry, asked, |dataset, column| {
        let (shape, pixels) = read(dataset, column, asked.episode, asked.step)?;
        let [height, width, channels] = shape;
        Ok(png::encode_channels(height, width, channels, &pixels)?)
    })
}

/// An episode as MP4, or as GIF where the program was built without MP4.
pub(super) fn video(
    opened: &Opened,
    registry: &Registry,
    asked: &Image,
) -> Result<(Format, Vec<u8>), Refusal> {
    let episode = asked.episode;
    let clip = with_images(opened, registry, asked, |dataset, column| {
        let mut clip: Option<Clip> = None;
        for step in 0..dataset.episode_len(episode) {
            let ([height, width, channels], pixels) = read(dataset, column, episode, step)?;
            if (step + 1) * height * width * 3 > MAX_VIDEO {
                return Err(Refusal::bad(format!(
                    "the video of episode {episode} has more than {} MB of frames; make it by the command `swm preview`",
                    MAX_VIDEO >> 20
                )));
            }
            let frame =
                if channels == 1 { pixels.iter().flat_map(|&gray| [gray; 3]).collect() } else { pixels };
            clip.get_or_insert_with(|| Clip::new(height, width, FRAMES_PER_SECOND)).push(&frame)?;
        }
        clip.ok_or_else(|| Refusal::bad(format!("episode {episode} has no steps")))
    })?;
    Ok(encode(&clip)?)
}

/// A video as MP4, or as GIF where the program was built without MP4.
pub(crate) fn encode(clip: &Clip) -> Result<(Format, Vec<u8>), MediaError> {
    match clip.encode(Format::Mp4) {
        Ok(bytes) => Ok((Format::Mp4, bytes)),
        Err(MediaError::NotBuilt { .. }) => Ok((Format::Gif, clip.encode(Format::Gif)?)),
        Err(error) => Err(error),
    }
}

/// Works on the dataset that holds or renders what is asked for, and on its column.
fn with_images<T>(
    opened: &Opened,
    registry: &Registry,
    asked: &Image,
    work: impl FnOnce(&mut dyn Dataset, &str) -> Result<T, Refusal>,
) -> Result<T, Refusal> {
    let Some(side) = asked.render else {
        let names = opened.image_columns();
        let name = asked.column.as_deref().or(names.first().copied());
        let name = name.ok_or_else(|| Refusal::bad("the dataset holds no images"))?;
        if !names.contains(&name) {
            return Err(Refusal::bad(format!("the column `{name}` holds no images")));
        }
        return work(opened.dataset().as_mut(), name);
    };
    if !(16..=MAX_SIDE).contains(&side) {
        return Err(Refusal::bad(format!("images have 16 to {MAX_SIDE} pixels a side, not {side}")));
    }
    let factors: BTreeMap<String, Json> = serde_json::from_str(asked.set.as_deref().unwrap_or("{}"))?;
    let key = format!("{side} {}", serde_json::to_string(&factors)?);
    let mut kept = opened.rendered.lock().unwrap_or_else(PoisonError::into_inner);
    if kept.as_ref().is_none_or(|(known, _)| *known != key) {
        let factors = factors.iter().map(|(name, value)| Ok((name.clone(), Value::from_json(name, value)?)));
        let factors = factors.collect::<Result<_, Refusal>>()?;
        let options =
            RenderOptions::default().image(ImageSize { height: side, width: side }).factors(factors);
        let dataset = opened.dataset().share();
        *kept = Some((key, Rendered::new(dataset, registry, &options)?));
    }
    let (_, dataset) = kept.as_mut().ok_or_else(|| Refusal::bad("nothing is rendered"))?;
    work(dataset, swm_core::env::PIXELS)
}

/// An image `[H, W, C]` and its shape.
fn read(
    dataset: &mut dyn Dataset,
    column: &str,
    episode: usize,
    step: usize,
) -> Result<([usize; 3], Vec<u8>), Refusal> {
    let index = dataset.schema().require(column)?;
    let field = &dataset.schema().fields()[index];
    let (&[height, width, channels], Dtype::U8) = (&field.shape[..], field.dtype) else {
        return Err(Refusal::bad(format!("the column `{column}` holds no images")));
    };
    let mut pixels = vec![0; height * width * channels];
    let steps = Steps { first: step, count: 1, stride: 1 };
    dataset.read_column(index, episode, steps, SliceMut::U8(&mut pixels))?;
    Ok(([height, width, channels], pixels))
}
