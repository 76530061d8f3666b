//! Latent dynamics: what a world model network provides for planning, and how its latents and predictions are computed.
//!
//! Observations go through the network one by one, latents in groups of a fixed size, padded with zeros: the bits of a
//! latent do not depend on other latents.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use swm_solvers::Aggregate;

use crate::data::{Form, Observations, Start};
use crate::error::BaselineError;
use crate::images;
use crate::params::host;

/// A network that predicts latents, and the cost of plans from them.
pub(crate) trait LatentDynamics: Module + Sync {
    /// Candidates of a group.
    const GROUP: usize;

    /// One planning problem: the encoded observations and goal, which all its candidates share.
    type Problem: Send + Sync;

    /// The form of its tensors.
    fn form(&self) -> &Form;

    /// N: the most observations that it uses.
    fn history(&self) -> usize;

    /// Encodes the planning problem `index` of `start`.
    fn problem(&self, start: &Start, index: usize) -> Self::Problem;

    /// `[C]`: costs of candidates `[C, H, D]` of one problem; [`aggregate`] makes them of distances from the goal.
    fn costs(&self, problem: &Self::Problem, plans: Tensor<3>, how: Aggregate) -> Tensor<1>;

    /// Z: values of a latent.
    fn latent_dim(&self) -> usize;

    /// `[1, Z]` of one observation: `[1, 1, 3, S, S]`, and `[1, 1, …]` where the model uses it.
    fn latent(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<2>;

    /// `[C, Z]`: the latents that follow `[C, Z]` under blocks `[C, D]`, each on its own.
    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2>;
}

/// `[C]`: costs of candidates from the distances `[C]` of their predicted states 0 to `horizon` - 1 from the goal.
pub(crate) fn aggregate(how: Aggregate, horizon: usize, distance: impl Fn(usize) -> Tensor<1>) -> Tensor<1> {
    let last = distance(horizon - 1);
    let all = || (0..horizon - 1).map(&distance).chain([last.clone()]);
    match how {
        Aggregate::Last => last,
        Aggregate::Mean => Tensor::stack::<2>(all().collect(), 1).mean_dim(1).squeeze_dim(1),
        Aggregate::Best => Tensor::stack::<2>(all().collect(), 1).min_dim(1).squeeze_dim(1),
    }
}

/// Fills `latents`, `[B, Z]`, with those of single observations.
pub(crate) fn encode<M: LatentDynamics>(
    model: &M,
    seen: &Observations<'_>,
    latents: &mut [f32],
    device: &Device,
) -> Result<(), BaselineError> {
    let (form, count) = (model.form(), seen.pixels.rows);
    check(latents.len(), count, model.latent_dim())?;
    let pixels = images::to_tensor("pixels", &seen.pixels, form.image, device)?;
    let proprio = form.state("proprio", seen.proprio.as_ref(), count, device)?;
    latents.par_chunks_exact_mut(model.latent_dim().max(1)).enumerate().for_each(|(index, latent)| {
        let proprio = proprio.as_ref().map(|proprio| proprio.clone().narrow(0, index, 1));
        latent.copy_from_slice(&host(model.latent(pixels.clone().narrow(0, index, 1), proprio)));
    });
    Ok(())
}

/// Replaces `latents`, `[B, Z]`, by the latents that follow under `actions`, `[B, D]`.
pub(crate) fn predict<M: LatentDynamics>(
    model: &M,
    latents: &mut [f32],
    actions: &[f32],
    device: &Device,
) -> Result<(), BaselineError> {
    let (dim, block) = (model.latent_dim().max(1), model.form().action);
    check(latents.len(), actions.len() / block.max(1), dim)?;
    let groups = latents.par_chunks_mut(M::GROUP * dim).zip_eq(actions.par_chunks(M::GROUP * block.max(1)));
    groups.for_each(|(latents, actions)| {
        let full = |values: &[f32], dim: usize| {
            let mut values = values.to_vec();
            values.resize(M::GROUP * dim, 0.0);
            Tensor::<2>::from_data(TensorData::new(values, [M::GROUP, dim]), device)
        };
        let next = host(model.next(full(latents, dim), full(actions, block)));
        latents.copy_from_slice(&next[..latents.len()]);
    });
    Ok(())
}

fn check(values: usize, count: usize, dim: usize) -> Result<(), BaselineError> {
    if values == count * dim {
        return Ok(());
    }
    let reason = format!("{values} values for {count} latents of {dim}; they must agree");
    Err(BaselineError::data("latents", reason))
}
