//! What agents share: tensors from values, gradients of a loss, the files of their optimizer.

use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use swm_core::env::PIXELS;

use super::agent::{AgentConfig, Observation};
use crate::baseline::Losses;
use crate::error::BaselineError;
use crate::reading::{finite, read};
use swm_nn::losses::Terms;
use swm_nn::optim::{AdamW, Gradients};
use swm_nn::params;

/// A tensor of this shape.
pub(super) fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// The values of a loss of `tracked`, and its gradients; an error where one is not finite. `index` is the update's.
pub(super) fn differentiate<M: Module>(
    tracked: &M,
    terms: Terms,
    index: u64,
) -> Result<(Losses, Gradients), BaselineError> {
    let mut gradients = terms.total.backward();
    let losses = read(&terms.inner());
    let mut gradients = Gradients::new(params::gradients(tracked, &mut gradients));
    finite(gradients.clip(None).value(), index)?;
    finite(losses.total, index)?;
    Ok((losses, gradients))
}

/// Refuses an observation and an action that this agent does not take.
pub(super) fn check_form(
    config: &AgentConfig,
    observation: &Observation<'_>,
    action: &[f32],
) -> Result<(), BaselineError> {
    let [inputs, outputs] = [config.observation_dim, config.action_dim];
    if observation.vector.len() != inputs || action.len() != outputs {
        let reason = format!(
            "{} values and an action of {}; this agent takes {inputs} and gives {outputs}",
            observation.vector.len(),
            action.len()
        );
        return Err(BaselineError::data("observation", reason));
    }
    match (config.image, observation.image) {
        (Some(_), None) => {
            Err(BaselineError::data(PIXELS, "there are no images, and this agent learned from them"))
        }
        _ => Ok(()),
    }
}

/// Number of trainable parameters: those that are neither statistics nor below `targets`.
pub(super) fn trainable<M: Module>(network: &M, targets: &[(&str, &str)]) -> usize {
    let is_target = |spec: &params::Spec| targets.iter().any(|(_, target)| spec.is_below(&[target]));
    let specs = params::specs(network);
    let trained = specs.iter().filter(|spec| !spec.is_buffer() && !is_target(spec));
    trained.map(|spec| spec.shape.iter().product::<usize>()).sum()
}

/// The state of an optimizer of `network` in a file that [`AdamW::to_host`] was written to.
///
/// # Errors
///
/// The file cannot be read, or is of another agent.
pub(super) fn load_optimizer<M: Module>(network: &M, path: &Path) -> Result<AdamW, BaselineError> {
    let mut tensors = swm_weights::read(path)?;
    let optimizer = AdamW::from_host(network, |name, count| {
        tensors.get(name).filter(|tensor| tensor.values.len() == count)?;
        tensors.remove(name).map(|tensor| tensor.values)
    });
    match tensors.keys().next() {
        None => Ok(optimizer),
        Some(name) => {
            let reason = format!(
                "the file holds `{name}`, which is no state of this agent's optimizer; it is of another run"
            );
            Err(BaselineError::weights(path, reason))
        }
    }
}
