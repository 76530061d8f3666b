//! Images of episodes: as they were recorded, or rendered by replaying the episode, with other factors too.

use std::collections::BTreeMap;
use std::sync::PoisonError;

use serde_json::Value as Json;
use swm_core::{Dtype, ImageSize, Registry, SliceMut, Value};
use swm_data::{Dataset, RenderOptions, Rendered, Steps};
use swm_media::png;

use super::opened::Opened;
use crate::error::Refusal;

/// The side of rendered images.
const MAX_SIDE: usize = 512;

/// A recorded image as PNG; no column: that of the observation.
pub(super) fn stored(
    opened: &Opened,
    column: Option<&str>,
    episode: usize,
    step: usize,
) -> Result<Vec<u8>, Refusal> {
    let names = opened.image_columns();
    let name =
        column.or(names.first().copied()).ok_or_else(|| Refusal::bad("the dataset holds no images"))?;
    if !names.contains(&name) {
        return Err(Refusal::bad(format!("the column `{name}` holds no images")));
    }
    encode(opened.dataset().as_mut(), name, episode, step)
}

/// An image as PNG that is rendered with `factors` in place of the recorded ones.
pub(super) fn rendered(
    opened: &Opened,
    registry: &Registry,
    side: usize,
    factors: &BTreeMap<String, Json>,
    episode: usize,
    step: usize,
) -> Result<Vec<u8>, Refusal> {
    if !(16..=MAX_SIDE).contains(&side) {
        return Err(Refusal::bad(format!("images have 16 to {MAX_SIDE} pixels a side, not {side}")));
    }
    let key = format!("{side} {}", serde_json::to_string(factors)?);
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
    encode(dataset, swm_core::env::PIXELS, episode, step)
}

fn encode(dataset: &mut dyn Dataset, column: &str, episode: usize, step: usize) -> Result<Vec<u8>, Refusal> {
    let index = dataset.schema().require(column)?;
    let field = dataset.schema().fields()[index].clone();
    let (&[height, width, channels], Dtype::U8) = (&field.shape[..], field.dtype) else {
        return Err(Refusal::bad(format!("the column `{column}` holds no images")));
    };
    let mut pixels = vec![0; height * width * channels];
    let steps = Steps { first: step, count: 1, stride: 1 };
    dataset.read_column(index, episode, steps, SliceMut::U8(&mut pixels))?;
    Ok(png::encode_channels(height, width, channels, &pixels)?)
}
