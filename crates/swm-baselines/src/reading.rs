//! The losses of steps, read at once or left on the device until somebody asks for them.

use burn::tensor::Tensor;

use crate::baseline::Losses;
use crate::error::BaselineError;
use swm_nn::losses::Terms;
use swm_nn::optim::Norm;
use swm_nn::params::host;

/// The values of a loss.
pub(crate) fn read(terms: &Terms) -> Losses {
    let value = |tensor: &Tensor<1>| host(tensor.clone())[0];
    Losses {
        total: value(&terms.total),
        parts: terms.parts.iter().map(|(name, tensor)| (*name, value(tensor))).collect(),
    }
}

/// The losses of a training step, and the norm of its gradients.
#[expect(clippy::large_enum_variant, reason = "there are as many as steps between two records")]
pub(crate) enum Reading {
    /// Their values, which are finite.
    Known(Losses),
    /// They wait on the device.
    Waiting {
        /// The step.
        step: u64,
        /// Its learning rate.
        lr: f32,
        /// Names of the parts.
        names: Vec<&'static str>,
        /// `[2 + parts]`: loss, norm, parts.
        values: Tensor<1>,
    },
}

impl Reading {
    /// Of a step whose losses are known. Waits for the norm; an error where it is not finite.
    pub(crate) fn known(mut losses: Losses, norm: Norm, lr: f32, step: u64) -> Result<Self, BaselineError> {
        let norm = finite(norm.value(), step)?;
        losses.parts.extend([("lr", lr), ("gradient_norm", norm)]);
        Ok(Self::Known(losses))
    }

    /// Of a step whose losses are on the device. Waits for nothing.
    pub(crate) fn waiting(terms: Terms, norm: Norm, lr: f32, step: u64) -> Self {
        let Terms { total, parts } = terms.inner();
        let device = total.device();
        let norm = match norm {
            Norm::Known(norm) => Tensor::from_data([norm], &device),
            Norm::Waiting(norm) => norm,
        };
        let (names, parts): (Vec<_>, Vec<Tensor<1>>) = parts.into_iter().unzip();
        let values = [total, norm].into_iter().chain(parts).collect();
        Self::Waiting { step, lr, names, values: Tensor::cat(values, 0) }
    }
}

/// The losses of steps, in order: with one transfer from the device, whatever their number.
///
/// # Errors
///
/// The loss or the norm of the gradients of a step is not finite: of the first such step.
pub(crate) fn read_all(readings: Vec<Reading>) -> Result<Vec<Losses>, BaselineError> {
    let waiting: Vec<Tensor<1>> = readings
        .iter()
        .filter_map(|reading| match reading {
            Reading::Waiting { values, .. } => Some(values.clone()),
            Reading::Known(_) => None,
        })
        .collect();
    let values = if waiting.is_empty() { Vec::new() } else { host(Tensor::cat(waiting, 0)) };
    let mut rest = values.into_iter();
    let losses = readings.into_iter().map(|reading| match reading {
        Reading::Known(losses) => Ok(losses),
        Reading::Waiting { step, lr, names, .. } => {
            let mut next = || rest.next().expect("a value for each that was sent");
            let (total, norm) = (next(), next());
            let mut parts: Vec<(&'static str, f32)> = names.into_iter().map(|name| (name, next())).collect();
            parts.extend([("lr", lr), ("gradient_norm", finite(norm, step)?)]);
            Ok(Losses { total: finite(total, step)?, parts })
        }
    });
    losses.collect()
}

/// A value that a step cannot go on without.
pub(crate) fn finite(value: f32, step: u64) -> Result<f32, BaselineError> {
    match value.is_finite() {
        true => Ok(value),
        false => Err(BaselineError::NotFinite { step, value }),
    }
}
