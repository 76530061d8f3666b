//! Latents of observations and what is predicted of them, apart from plans: what the quality of a world model is measured by.
//!
//! Observations go through the network one by one, latents in groups of a fixed size, filled up where they are not full: the
//! bits of a latent depend on nothing beside it.

use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use crate::data::Observations;
use crate::error::BaselineError;
use crate::images;
use crate::params::host;
use crate::plan::SceneModel;

/// Fills `latents`, `[B, Z]`.
pub(crate) fn encode<M: SceneModel>(
    model: &M,
    seen: &Observations<'_>,
    latents: &mut [f32],
    device: &Device,
) -> Result<(), BaselineError> {
    let (form, rows) = (model.form(), seen.pixels.rows);
    check(latents.len(), rows, model.latent_width())?;
    let pixels = images::to_tensor("pixels", &seen.pixels, form.image, device)?;
    let proprio = form.state("proprio", seen.proprio.as_ref(), rows, device)?;
    latents.par_chunks_exact_mut(model.latent_width().max(1)).enumerate().for_each(|(row, latent)| {
        let proprio = proprio.as_ref().map(|proprio| proprio.clone().narrow(0, row, 1));
        latent.copy_from_slice(&host(model.latent(pixels.clone().narrow(0, row, 1), proprio)));
    });
    Ok(())
}

/// Replaces `latents`, `[B, Z]`, by what follows them under `actions`, `[B, D]`.
pub(crate) fn predict<M: SceneModel>(
    model: &M,
    latents: &mut [f32],
    actions: &[f32],
    device: &Device,
) -> Result<(), BaselineError> {
    let (width, block) = (model.latent_width().max(1), model.form().action);
    check(latents.len(), actions.len() / block.max(1), width)?;
    let groups = latents.par_chunks_mut(M::GROUP * width).zip_eq(actions.par_chunks(M::GROUP * block.max(1)));
    groups.for_each(|(latents, actions)| {
        let full = |values: &[f32], width: usize| {
            let mut values = values.to_vec();
            values.resize(M::GROUP * width, 0.0);
            Tensor::<2>::from_data(TensorData::new(values, [M::GROUP, width]), device)
        };
        let next = host(model.next(full(latents, width), full(actions, block)));
        latents.copy_from_slice(&next[..latents.len()]);
    });
    Ok(())
}

fn check(numbers: usize, rows: usize, width: usize) -> Result<(), BaselineError> {
    if numbers == rows * width {
        return Ok(());
    }
    let reason = format!("{numbers} numbers of latents for {rows} rows of {width}; they must agree");
    Err(BaselineError::data("latents", reason))
}
