//! AdamW as PyTorch computes it (arXiv 1711.05101), for tensors by name.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::OptimConfig;
use crate::params::{self, Spec, host};

/// Gradients in the order of a network's tensors, in our layout; `None` for tensors that do not change.
pub(crate) type Gradients = Vec<Option<Vec<f32>>>;

/// Its state: averages of gradients and of their squares, and the number of steps of each tensor. On the host, where one
/// loop over a tensor does what would be a dozen operations on tensors.
#[derive(Default)]
pub(crate) struct AdamW {
    moments: BTreeMap<String, Moments>,
}

struct Moments {
    mean: Vec<f32>,
    square: Vec<f32>,
    steps: u64,
}

/// Values that a thread takes at a time.
const PART: usize = 1 << 16;

impl AdamW {
    /// One step along `gradients` at this learning rate.
    pub(crate) fn step<M: Module>(
        &mut self,
        network: M,
        gradients: Gradients,
        config: &OptimConfig,
        lr: f64,
    ) -> M {
        let mut gradients = gradients.into_iter();
        params::map(network, |spec, weight| match gradients.next().flatten() {
            Some(gradient) => self.change(spec, weight, &gradient, config, lr),
            None => weight,
        })
    }

    fn change(
        &mut self,
        spec: &Spec,
        weight: Tensor<1>,
        gradient: &[f32],
        config: &OptimConfig,
        lr: f64,
    ) -> Tensor<1> {
        let device = weight.device();
        let moments = self.moments.entry(spec.name.clone()).or_insert_with(|| Moments {
            mean: vec![0.0; gradient.len()],
            square: vec![0.0; gradient.len()],
            steps: 0,
        });
        moments.steps += 1;
        let correction = |beta: f64| 1.0 - beta.powi(moments.steps as i32);
        let [of_mean, of_square] = config.betas.map(correction);
        let (size, root) = ((lr / of_mean) as f32, of_square.sqrt() as f32);
        let (kept, epsilon) = ((1.0 - lr * config.weight_decay) as f32, config.epsilon as f32);
        let [beta_mean, beta_square] = config.betas.map(|beta| beta as f32);
        let [new_mean, new_square] = config.betas.map(|beta| (1.0 - beta) as f32);
        let mut weights = host(weight);
        let parts = weights.par_chunks_mut(PART).zip(gradient.par_chunks(PART));
        let averages = moments.mean.par_chunks_mut(PART).zip(moments.square.par_chunks_mut(PART));
        parts.zip(averages).for_each(|((weights, gradient), (means, squares))| {
            let averages = means.iter_mut().zip(squares);
            for ((weight, gradient), (mean, square)) in weights.iter_mut().zip(gradient).zip(averages) {
                *mean = *mean * beta_mean + gradient * new_mean;
                *square = *square * beta_square + gradient * gradient * new_square;
                *weight = *weight * kept - *mean / (square.sqrt() / root + epsilon) * size;
            }
        });
        let count = weights.len();
        Tensor::from_data(TensorData::new(weights, [count]), &device)
    }

    /// The state, by name: `<tensor>.mean` and `.square` in PyTorch's layout, and `.steps`.
    pub(crate) fn to_host<M: Module>(&self, network: &M) -> Vec<(String, Vec<usize>, Vec<f32>)> {
        let mut state = Vec::new();
        params::visit(network, |spec, weight| {
            let Some(moments) = self.moments.get(&spec.name) else { return };
            let mut add = |name: &str, values: &Vec<f32>| {
                let data = TensorData::new(values.clone(), [values.len()]);
                let values = params::to_host(spec, Tensor::from_data(data, &weight.device()));
                state.push((format!("{}.{name}", spec.name), spec.shape.clone(), values));
            };
            add("mean", &moments.mean);
            add("square", &moments.square);
            // Exact up to 2²⁴ steps.
            state.push((format!("{}.steps", spec.name), vec![1], vec![moments.steps as f32]));
        });
        state
    }

    /// Takes a state that [`AdamW::to_host`] gave; `take` gives the values of a name, if there are so many.
    pub(crate) fn from_host<M: Module>(
        network: &M,
        mut take: impl FnMut(&str, usize) -> Option<Vec<f32>>,
    ) -> Self {
        let mut moments = BTreeMap::new();
        params::visit(network, |spec, weight| {
            let count: usize = spec.shape.iter().product();
            let mut part = |name: &str, count| take(&format!("{}.{name}", spec.name), count);
            let found = (part("mean", count), part("square", count), part("steps", 1));
            if let (Some(mean), Some(square), Some(steps)) = found {
                let [mean, square] =
                    [mean, square].map(|values| host(params::from_host(spec, values, &weight)));
                let steps = steps.first().map_or(0, |steps| *steps as u64);
                moments.insert(spec.name.clone(), Moments { mean, square, steps });
            }
        });
        Self { moments }
    }
}

/// The norm of all gradients together, after which they are no longer than `clip`.
pub(crate) fn clip_gradients(gradients: &mut Gradients, clip: Option<f64>) -> f32 {
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
