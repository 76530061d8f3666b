//! AdamW as PyTorch computes it (arXiv 1711.05101), for tensors by name: on the host where the network is on a CPU,
//! otherwise on the device (`joined.rs`).

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::gradients::Gradients;
use super::joined::JoinedMoments;
use super::{OptimConfig, PART};
use crate::params::{self, Spec, host};

/// Its state: averages of gradients and of their squares, and the number of steps of each tensor.
#[derive(Default)]
pub struct AdamW {
    /// On the host, where one loop over a tensor does what would be a dozen operations on tensors; also what a file held,
    /// until a device takes it up.
    pub(super) moments: BTreeMap<String, Moments>,
    /// On the device.
    pub(super) on_device: Vec<JoinedMoments>,
}

pub(super) struct Moments {
    pub(super) mean: Vec<f32>,
    pub(super) square: Vec<f32>,
    pub(super) steps: u64,
}

/// The factors of a step.
pub(super) struct Rates {
    pub(super) beta_mean: f32,
    pub(super) new_mean: f32,
    pub(super) beta_square: f32,
    pub(super) new_square: f32,
    /// What the mean is scaled by: the learning rate, corrected for the average's bias.
    pub(super) size: f32,
    /// The correction below the square root.
    pub(super) root: f32,
    /// What is left of a weight after its decay.
    pub(super) kept: f32,
    pub(super) epsilon: f32,
}

impl Rates {
    /// Of a tensor's step number `steps`, from 1.
    pub(super) fn new(config: &OptimConfig, lr: f64, steps: u64) -> Self {
        let correction = |beta: f64| 1.0 - beta.powi(steps as i32);
        let [of_mean, of_square] = config.betas.map(correction);
        let [beta_mean, beta_square] = config.betas.map(|beta| beta as f32);
        let [new_mean, new_square] = config.betas.map(|beta| (1.0 - beta) as f32);
        Self {
            beta_mean,
            new_mean,
            beta_square,
            new_square,
            size: (lr / of_mean) as f32,
            root: of_square.sqrt() as f32,
            kept: (1.0 - lr * config.weight_decay) as f32,
            epsilon: config.epsilon as f32,
        }
    }
}

impl AdamW {
    /// One step along `gradients` at this learning rate.
    pub fn step<M: Module>(&mut self, network: M, gradients: Gradients, config: &OptimConfig, lr: f64) -> M {
        let mut gradients = match gradients {
            Gradients::Host(gradients) => gradients.into_iter(),
            Gradients::Device(joined) => return self.step_joined(network, &joined, config, lr),
        };
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
        let Rates { beta_mean, new_mean, beta_square, new_square, size, root, kept, epsilon } =
            Rates::new(config, lr, moments.steps);
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
    pub fn to_host<M: Module>(&self, network: &M) -> Vec<(String, Vec<usize>, Vec<f32>)> {
        let mut state = Vec::new();
        params::visit(network, |spec, weight| {
            let joined = || self.on_device.iter().find_map(|joined| joined.of(&spec.name));
            let on_host = |Moments { mean, square, steps }: &Moments| {
                let tensor = |values: &Vec<f32>| {
                    Tensor::<1>::from_data(TensorData::new(values.clone(), [values.len()]), &weight.device())
                };
                (tensor(mean), tensor(square), *steps)
            };
            let Some((mean, square, steps)) = self.moments.get(&spec.name).map(on_host).or_else(joined)
            else {
                return;
            };
            for (name, values) in [("mean", mean), ("square", square)] {
                let values = params::to_host(spec, values);
                state.push((format!("{}.{name}", spec.name), spec.shape.clone(), values));
            }
            // Exact up to 2²⁴ steps.
            state.push((format!("{}.steps", spec.name), vec![1], vec![steps as f32]));
        });
        state
    }

    /// Takes a state that [`AdamW::to_host`] gave; `take` gives the values of a name, if there are so many.
    pub fn from_host<M: Module>(network: &M, mut take: impl FnMut(&str, usize) -> Option<Vec<f32>>) -> Self {
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
        Self { moments, on_device: Vec::new() }
    }
}
