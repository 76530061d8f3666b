//! From the loader's tables to inputs of models: vectors are scaled, images are not copied.

use std::collections::BTreeMap;

use swm_core::env::PIXELS;
use swm_core::{Batch, Slice};
use swm_data::rendered::CANONICAL;

use super::data::{ACTION, PROPRIO};
use super::latents::LATENT;
use super::scale::Scale;
use crate::data::{ClipBatch, Images, Vectors};
use crate::error::BaselineError;

/// Scales the vectors of batches; its memory is reused.
pub(super) struct ClipFeed<'a> {
    scales: &'a BTreeMap<String, Scale>,
    action: Vec<f32>,
    proprio: Vec<f32>,
    goal_proprio: Vec<f32>,
}

impl<'a> ClipFeed<'a> {
    pub(super) fn new(scales: &'a BTreeMap<String, Scale>) -> Self {
        Self { scales, action: Vec::new(), proprio: Vec::new(), goal_proprio: Vec::new() }
    }

    /// The clips of a loader's table.
    pub(super) fn clips<'b>(&'b mut self, batch: &'b Batch) -> Result<ClipBatch<'b>, BaselineError> {
        let Self { scales, action, proprio, goal_proprio } = self;
        let missing =
            || BaselineError::data(PIXELS, "the batch has no such images; read it with the run's loader");
        let latents = stored(batch, LATENT);
        let none = |latents: Vectors<'b>| {
            let Vectors { rows, steps, .. } = latents;
            Images { values: &[], rows, steps, height: 0, width: 0, channels_last: false }
        };
        let vectors = |name: &str, scale: &str, out| vectors(batch, name, scales.get(scale)?, out);
        Ok(ClipBatch {
            pixels: images(batch, PIXELS).or(latents.map(none)).ok_or_else(missing)?,
            latents,
            canonical: images(batch, CANONICAL),
            action: vectors(ACTION, ACTION, action).ok_or_else(|| {
                BaselineError::data(ACTION, "the batch has none; read it with the run's loader")
            })?,
            proprio: vectors(PROPRIO, PROPRIO, proprio),
            goal_pixels: images(batch, "goal_pixels"),
            goal_proprio: vectors("goal_proprio", PROPRIO, goal_proprio),
        })
    }
}

/// A column `[T, 3, H, W]`, if there is one of this name.
fn images<'b>(batch: &'b Batch, name: &str) -> Option<Images<'b>> {
    let index = batch.schema().index(name)?;
    let (Slice::U8(values), &[steps, 3, height, width]) =
        (batch.column(index), &batch.schema().fields()[index].shape[..])
    else {
        return None;
    };
    Some(Images { values, rows: batch.rows(), steps, height, width, channels_last: false })
}

/// A column `[T, D]` as it is, if there is one of this name.
fn stored<'b>(batch: &'b Batch, name: &str) -> Option<Vectors<'b>> {
    let index = batch.schema().index(name)?;
    let (Slice::F32(values), &[steps, dim]) =
        (batch.column(index), &batch.schema().fields()[index].shape[..])
    else {
        return None;
    };
    Some(Vectors { values, rows: batch.rows(), steps, dim })
}

/// A column `[T, D]`, scaled, if there is one of this name.
fn vectors<'b>(batch: &Batch, name: &str, scale: &Scale, out: &'b mut Vec<f32>) -> Option<Vectors<'b>> {
    let index = batch.schema().index(name)?;
    let (column, shape) = (batch.column(index), &batch.schema().fields()[index].shape);
    let steps = *shape.first()?;
    out.clear();
    match column {
        Slice::F32(values) => out.extend_from_slice(values),
        other => out.extend((0..other.len()).map(|at| other.as_f64(at).unwrap_or(f64::NAN) as f32)),
    }
    scale.apply(out);
    Some(Vectors { values: out, rows: batch.rows(), steps, dim: shape[1..].iter().product() })
}
