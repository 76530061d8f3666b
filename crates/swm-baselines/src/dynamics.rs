//! Latent dynamics: what a world model network provides for planning, and how its latents and predictions are computed.
//!
//! On a CPU, observations and latents go through the network in groups that its caches hold. The bits of a latent do not depend on
//! other latents, since those of a [product](crate::kernels) do not depend on other rows. Other devices take many at once.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use swm_solvers::Aggregate;

use crate::data::{Form, Observations, Start};
use crate::error::BaselineError;
use crate::images;
use swm_nn::params::host;
use swm_nn::placement::Placement;

/// A network that predicts latents, and the cost of plans from them.
pub(crate) trait LatentDynamics: Module + Sync {
    /// Candidates of a group on a CPU: as many as its caches hold.
    const GROUP: usize;

    /// Candidates of a group on other devices: all, unless a candidate is large for the device's memory.
    const GROUP_ON_DEVICE: usize = usize::MAX;

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

    /// `[C, H, Z]`: the latents that candidates `[C, H, D]` of one problem lead to.
    fn states(&self, problem: &Self::Problem, plans: Tensor<3>) -> Tensor<3>;

    /// Z: values of a latent.
    fn latent_dim(&self) -> usize;

    /// `[B, Z]` of single observations: `[B, 1, 3, S, S]`, and `[B, 1, …]` where the model uses it.
    fn latent(&self, pixels: Tensor<5>, proprio: Option<Tensor<3>>) -> Tensor<2>;

    /// `[C, Z]`: the latents that follow `[C, Z]` under blocks `[C, D]`, each on its own.
    fn next(&self, latents: Tensor<2>, actions: Tensor<2>) -> Tensor<2>;
}

/// Images of a group on a CPU.
const IMAGES: usize = 8;

/// How many of `count` candidates go through a network at once.
pub(crate) fn group_size<M: LatentDynamics>(device: &Device, count: usize) -> usize {
    even::<M>(device, M::GROUP, count)
}

/// Groups of about one size: on a CPU of `most` at most, and one for each thread at least.
fn even<M: LatentDynamics>(device: &Device, most: usize, count: usize) -> usize {
    let count = count.max(1);
    let most = match Placement::of(device) {
        Placement::Host => most.min(count.div_ceil(rayon::current_num_threads())),
        Placement::Device => M::GROUP_ON_DEVICE,
    };
    count.div_ceil(count.div_ceil(most))
}

/// Work on each of `groups`: on a CPU by all threads, on other devices one after another, as the device is parallel itself.
pub(crate) fn for_each_group<G: Send>(device: &Device, groups: Vec<G>, work: impl Fn(G) + Sync + Send) {
    match Placement::of(device) {
        Placement::Host => groups.into_par_iter().for_each(work),
        Placement::Device => groups.into_iter().for_each(work),
    }
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
    let pixels = images::to_tensor("pixels", &seen.pixels, (form.image, form.normalization), device)?;
    let proprio = form.state("proprio", seen.proprio.as_ref(), count, device)?;
    let dim = model.latent_dim().max(1);
    let most = even::<M>(device, IMAGES, count);
    let groups: Vec<_> = latents.chunks_mut(most * dim).enumerate().collect();
    for_each_group(device, groups, |(index, latents)| {
        let part = latents.len() / dim;
        let proprio = proprio.as_ref().map(|proprio| proprio.clone().narrow(0, index * most, part));
        let found = model.latent(pixels.clone().narrow(0, index * most, part), proprio);
        latents.copy_from_slice(&host(found));
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
    let block = block.max(1);
    let most = group_size::<M>(device, actions.len() / block);
    let groups: Vec<_> = latents.chunks_mut(most * dim).zip(actions.chunks(most * block)).collect();
    for_each_group(device, groups, |(latents, actions)| {
        let next = model.next(rows(latents, dim, device), rows(actions, block, device));
        latents.copy_from_slice(&host(next));
    });
    Ok(())
}

/// Fills `next`, `[B, Z]`, with the latents that follow `latents` under `actions`, `[B, D]`, and `gradient`, `[B, D]`, with the
/// derivative of Σ ‖next − target‖² with respect to the actions.
pub(crate) fn step_toward<M: LatentDynamics>(
    model: &M,
    (latents, actions, targets): (&[f32], &[f32], &[f32]),
    next: &mut [f32],
    gradient: &mut [f32],
    device: &Device,
) -> Result<(), BaselineError> {
    let (dim, block) = (model.latent_dim().max(1), model.form().action.max(1));
    for values in [latents.len(), targets.len(), next.len()] {
        check(values, actions.len() / block, dim)?;
    }
    let most = group_size::<M>(device, actions.len() / block);
    let given = latents.chunks(most * dim).zip(actions.chunks(most * block)).zip(targets.chunks(most * dim));
    let found = next.chunks_mut(most * dim).zip(gradient.chunks_mut(most * block));
    for_each_group(
        device,
        given.zip(found).collect(),
        |(((latents, actions), targets), (next, gradient))| {
            let actions = rows(actions, block, device).autodiff().require_grad();
            let reached = model.next(rows(latents, dim, device).autodiff(), actions.clone());
            // Rows do not interact, so the derivative of the sum holds that of each.
            let off = reached.clone() - rows(targets, dim, device).autodiff();
            let gradients = (off.clone() * off).sum().backward();
            next.copy_from_slice(&host(reached));
            let by_action = actions.grad(&gradients).map(host).unwrap_or_default();
            gradient.iter_mut().zip(by_action).for_each(|(out, value)| *out = value);
        },
    );
    Ok(())
}

/// Rows of so many values.
fn rows(values: &[f32], width: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len() / width, width]), device)
}

fn check(values: usize, count: usize, dim: usize) -> Result<(), BaselineError> {
    if values == count * dim {
        return Ok(());
    }
    let reason = format!("{values} values for {count} latents of {dim}; they must agree");
    Err(BaselineError::data("latents", reason))
}
