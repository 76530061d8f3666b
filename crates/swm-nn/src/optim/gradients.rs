//! Gradients of a network: their norm, and how it is bounded.

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::PART;
use crate::params::host;
use crate::placement::Placement;

/// Gradients in the order of a network's tensors, flat and in our layout; `None` for tensors that do not change.
#[expect(clippy::large_enum_variant, reason = "a step has one of them")]
pub enum Gradients {
    /// One by one, on the host.
    Host(Vec<Option<Vec<f32>>>),
    /// End to end, on the device.
    Device(Joined),
}

/// The tensors that have a gradient, end to end: a handful of operations serve all of them.
pub struct Joined {
    /// All values.
    pub(super) values: Tensor<1>,
    /// Values of each tensor of the network; `None` for those without a gradient.
    pub(super) sizes: Vec<Option<usize>>,
}

/// The norm of all gradients together.
#[expect(clippy::large_enum_variant, reason = "a step has one of them")]
pub enum Norm {
    /// Its value.
    Known(f32),
    /// `[1]`, on the device.
    Waiting(Tensor<1>),
}

impl Gradients {
    /// Takes gradients to where the optimizer works.
    pub fn new(gradients: Vec<Option<Tensor<1>>>) -> Self {
        let first = gradients.iter().flatten().next();
        match first.map(|gradient| Placement::of(&gradient.device())) {
            Some(Placement::Device) => Self::Device(Joined::new(gradients)),
            _ => Self::Host(gradients.into_iter().map(|gradient| gradient.map(host)).collect()),
        }
    }

    /// The norm of all gradients together, after which they are no longer than `clip`.
    pub fn clip(&mut self, clip: Option<f64>) -> Norm {
        match self {
            Self::Host(gradients) => Norm::Known(clip_on_host(gradients, clip)),
            Self::Device(joined) => Norm::Waiting(joined.clip(clip)),
        }
    }

    /// Those of the tensors that `of` names by their index. A gradient is to be asked for once.
    pub fn take(&mut self, of: impl Fn(usize) -> bool) -> Self {
        match self {
            Self::Host(gradients) => {
                let taken = gradients.iter_mut().enumerate();
                Self::Host(taken.map(|(index, gradient)| gradient.take_if(|_| of(index))).collect())
            }
            Self::Device(joined) => match joined.only(of) {
                Some(taken) => Self::Device(taken),
                None => Self::Host(vec![None; joined.sizes.len()]),
            },
        }
    }
}

impl Norm {
    /// Its value, for which this waits.
    pub fn value(self) -> f32 {
        match self {
            Self::Known(value) => value,
            Self::Waiting(norm) => host(norm)[0],
        }
    }
}

impl Joined {
    fn new(gradients: Vec<Option<Tensor<1>>>) -> Self {
        let sizes =
            gradients.iter().map(|gradient| gradient.as_ref().map(|values| values.dims()[0])).collect();
        let values = Tensor::cat(gradients.into_iter().flatten().map(Tensor::inner).collect(), 0);
        Self { values, sizes }
    }

    fn clip(&mut self, clip: Option<f64>) -> Tensor<1> {
        let norm = self.values.clone().square().sum().sqrt();
        if let Some(clip) = clip {
            // PyTorch's formula, with its 1e-6.
            let factor = ((norm.clone() + 1e-6).recip() * clip).clamp_max(1.0);
            self.values = self.values.clone() * factor;
        }
        norm
    }

    /// Those of some tensors; `None` if there are none.
    pub(super) fn only(&self, of: impl Fn(usize) -> bool) -> Option<Self> {
        let (mut parts, mut start) = (Vec::new(), 0);
        let mut sizes = self.sizes.clone();
        for (index, size) in sizes.iter_mut().enumerate() {
            let Some(count) = *size else { continue };
            if of(index) {
                parts.push(self.values.clone().narrow(0, start, count));
            } else {
                *size = None;
            }
            start += count;
        }
        (!parts.is_empty()).then(|| Self { values: Tensor::cat(parts, 0), sizes })
    }
}

fn clip_on_host(gradients: &mut [Option<Vec<f32>>], clip: Option<f64>) -> f32 {
    let square = |part: &[f32]| part.iter().map(|value| f64::from(*value) * f64::from(*value)).sum::<f64>();
    // Sums of parts of a fixed size, added in order: the same bits on any number of threads.
    let squares = gradients
        .iter()
        .flatten()
        .map(|gradient| gradient.par_chunks(PART).map(square).collect::<Vec<f64>>().into_iter().sum::<f64>());
    let norm = squares.sum::<f64>().sqrt();
    // PyTorch's formula, with its 1e-6.
    let factor = clip.map_or(1.0, |clip| (clip / (norm + 1e-6)).min(1.0)) as f32;
    if factor < 1.0 {
        for gradient in gradients.iter_mut().flatten() {
            gradient.par_chunks_mut(PART).for_each(|part| part.iter_mut().for_each(|value| *value *= factor));
        }
    }
    norm as f32
}
