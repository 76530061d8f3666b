//! Latents of a frozen encoder in place of images: each image of a training is encoded once, before its first step.

use std::sync::Arc;

use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::{BatchOptions, ClipOptions, Dataset, Loader, MemoryDataset, Steps};

use super::clips::ClipFeed;
use super::data::{ACTION, PhaseClips, TrainData};
use crate::baseline::{Baseline, PlanModel};
use crate::data::Observations;
use crate::error::BaselineError;

/// The column that latents stand in.
pub(super) const LATENT: &str = "latent";

/// Frames that are encoded at a time.
const FRAMES: usize = 256;

/// The same clips with latents in place of images; `None` if `model` trains on images.
pub(super) fn encoded(data: &TrainData, model: &dyn Baseline) -> Result<Option<TrainData>, BaselineError> {
    let Some(mut encoder) = model.planner().filter(|_| model.trains_on_latents()) else { return Ok(None) };
    let mut encode = |dataset: &dyn Dataset| -> Result<Box<dyn Dataset>, BaselineError> {
        Ok(Box::new(encode(dataset, encoder.as_mut(), data)?))
    };
    let parts = [encode(data.parts[0].as_ref())?, encode(data.parts[1].as_ref())?];
    let options = data.options.clone().keys(Some([LATENT, ACTION].map(str::to_owned).into())).image(None);
    let phases = data.phases.iter().map(|_| PhaseClips::new(&parts, &options)).collect::<Result<_, _>>()?;
    Ok(Some(TrainData { phases, config: data.config.clone(), parts, options }))
}

/// The same episodes, as latents and actions.
fn encode(
    dataset: &dyn Dataset,
    encoder: &mut dyn PlanModel,
    data: &TrainData,
) -> Result<MemoryDataset, BaselineError> {
    let mut dataset = dataset.share();
    let column = dataset.schema().index(ACTION).expect("no training without actions");
    let dim = encoder.latent_dim();
    let fields = [Field::step(LATENT, Dtype::F32, &[dim]), dataset.schema().fields()[column].clone()];
    let schema = Schema::new(fields.into()).expect("two columns of different names");
    let latents = latents(dataset.as_ref(), encoder, data)?;
    let mut rest = &latents[..];
    let mut episodes = Vec::with_capacity(dataset.num_episodes());
    for episode in 0..dataset.num_episodes() {
        let rows = dataset.episode_len(episode);
        let mut table = Batch::new(schema.clone(), rows);
        let (own, others) = rest.split_at(rows * dim);
        rest = others;
        if let SliceMut::F32(out) = table.column_mut(0) {
            out.copy_from_slice(own);
        }
        let steps = Steps { first: 0, count: rows, stride: 1 };
        dataset.rows(column, episode, steps, table.column_mut(1))?;
        episodes.push(Arc::new(table));
    }
    Ok(MemoryDataset::new(&data.config.path.to_string_lossy(), schema, None, episodes)?)
}

/// `[R, Z]`: the latents of all rows, episode by episode.
fn latents(
    dataset: &dyn Dataset,
    encoder: &mut dyn PlanModel,
    data: &TrainData,
) -> Result<Vec<f32>, BaselineError> {
    let mut all = Vec::new();
    if dataset.num_episodes() == 0 {
        return Ok(all);
    }
    let options: ClipOptions = data.options.clone().num_steps(1).frameskip(1);
    let frames = Loader::new(dataset.share(), &options)?;
    let mut batches = frames.batches(&BatchOptions::default().size(FRAMES).epochs(Some(1)))?;
    let mut batch = batches.new_batch();
    let mut feed = ClipFeed::new(&data.config.scales);
    while batches.next_batch(&mut batch)? {
        let clips = feed.clips(&batch)?;
        let before = all.len();
        all.resize(before + batch.rows() * encoder.latent_dim(), 0.0);
        let seen = Observations { pixels: clips.pixels, proprio: clips.proprio };
        encoder.encode(&seen, &mut all[before..])?;
    }
    Ok(all)
}
