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
    let Some(mut encoder) = model.latent_encoder().filter(|_| model.trains_on_latents()) else {
        return Ok(None);
    };
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
    let fields =
        [Field::step(LATENT, Dtype::F32, &[encoder.latent_dim()]), dataset.schema().fields()[column].clone()];
    let schema = Schema::new(fields.into()).expect("two columns of different names");
    let mut episodes = Vec::with_capacity(dataset.num_episodes());
    for episode in 0..dataset.num_episodes() {
        let rows = dataset.episode_len(episode);
        let mut table = Batch::new(schema.clone(), rows);
        let steps = Steps { first: 0, count: rows, stride: 1 };
        dataset.rows(column, episode, steps, table.column_mut(1))?;
        episodes.push(table);
    }
    if !episodes.is_empty() {
        fill_latents(&mut episodes, dataset, encoder, data)?;
    }
    let episodes = episodes.into_iter().map(Arc::new);
    Ok(MemoryDataset::new(&data.config.path.to_string_lossy(), schema, None, episodes)?)
}

/// Encodes the frames of all episodes, in their order.
fn fill_latents(
    episodes: &mut [Batch],
    dataset: Box<dyn Dataset>,
    encoder: &mut dyn PlanModel,
    data: &TrainData,
) -> Result<(), BaselineError> {
    let dim = encoder.latent_dim();
    let options: ClipOptions = data.options.clone().num_steps(1).frameskip(1);
    let frames = Loader::new(dataset, &options)?;
    let mut batches = frames.batches(&BatchOptions::default().size(FRAMES).epochs(Some(1)))?;
    let mut batch = batches.new_batch();
    let mut feed = ClipFeed::new(&data.config.scales);
    let mut latents = Vec::new();
    let mut places = episodes.iter_mut().flat_map(|table| match table.column_mut(0) {
        SliceMut::F32(values) => values.chunks_exact_mut(dim),
        _ => unreachable!("the column was made as f32"),
    });
    while batches.next_batch(&mut batch)? {
        let clips = feed.clips(&batch)?;
        latents.resize(batch.rows() * dim, 0.0);
        let seen = Observations { pixels: clips.pixels, proprio: clips.proprio };
        encoder.encode(&seen, &mut latents)?;
        latents.chunks_exact(dim).zip(&mut places).for_each(|(latent, place)| place.copy_from_slice(latent));
    }
    Ok(())
}
