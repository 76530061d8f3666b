//! AdamW as PyTorch computes it (arXiv 1711.05101), on tensors by name.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Tensor;

use super::OptimConfig;
use crate::params::{self, Spec, host};

/// Its state: averages of gradients and of their squares, and the number of steps of each tensor.
#[derive(Default)]
pub(crate) struct AdamW {
    moments: BTreeMap<String, Moments>,
}

struct Moments {
    mean: Tensor<1>,
    square: Tensor<1>,
    steps: u64,
}

impl AdamW {
    /// One step along `gradients`, which are in the order of the network's tensors, at this learning rate.
    pub(crate) fn step<M: Module>(
        &mut self,
        network: M,
        gradients: Vec<Option<Tensor<1>>>,
        config: &OptimConfig,
        lr: f64,
    ) -> M {
        let mut gradients = gradients.into_iter();
        params::map(network, |spec, weight| match gradients.next().flatten() {
            Some(gradient) => self.change(spec, weight, gradient, config, lr),
            None => weight,
        })
    }

    fn change(
        &mut self,
        spec: &Spec,
        weight: Tensor<1>,
        gradient: Tensor<1>,
        config: &OptimConfig,
        lr: f64,
    ) -> Tensor<1> {
        let [beta_mean, beta_square] = config.betas;
        let moments = self.moments.entry(spec.name.clone()).or_insert_with(|| Moments {
            mean: gradient.zeros_like(),
            square: gradient.zeros_like(),
            steps: 0,
        });
        let (mean, square) = (moments.mean.clone(), moments.square.clone());
        moments.steps += 1;
        moments.mean = mean * beta_mean + gradient.clone() * (1.0 - beta_mean);
        moments.square = square * beta_square + gradient.square() * (1.0 - beta_square);
        let correction = |beta: f64| 1.0 - beta.powi(moments.steps as i32);
        let root = moments.square.clone().sqrt() / correction(beta_square).sqrt() + config.epsilon;
        let step = moments.mean.clone() / root * (lr / correction(beta_mean));
        weight * (1.0 - lr * config.weight_decay) - step
    }

    /// The state, by name: `<tensor>.mean` and `.square` in PyTorch's layout, and `.steps`.
    pub(crate) fn to_host<M: Module>(&self, network: &M) -> Vec<(String, Vec<usize>, Vec<f32>)> {
        let mut state = Vec::new();
        for spec in params::specs(network) {
            let Some(moments) = self.moments.get(&spec.name) else { continue };
            let mut add = |name: &str, tensor: &Tensor<1>| {
                let values = params::to_host(&spec, tensor.clone());
                state.push((format!("{}.{name}", spec.name), spec.shape.clone(), values));
            };
            add("mean", &moments.mean);
            add("square", &moments.square);
            // Exact up to 2²⁴ steps.
            state.push((format!("{}.steps", spec.name), vec![1], vec![moments.steps as f32]));
        }
        state
    }

    /// Takes a state that [`AdamW::to_host`] gave; `take` gives the numbers of a name.
    pub(crate) fn from_host<M: Module>(network: &M, mut take: impl FnMut(&str) -> Option<Vec<f32>>) -> Self {
        let mut moments = BTreeMap::new();
        params::visit(network, |spec, weight| {
            let mut part = |name: &str| take(&format!("{}.{name}", spec.name));
            if let (Some(mean), Some(square), Some(steps)) = (part("mean"), part("square"), part("steps")) {
                let [mean, square] = [mean, square].map(|values| params::from_host(spec, values, &weight));
                let steps = steps.first().map_or(0, |steps| *steps as u64);
                moments.insert(spec.name.clone(), Moments { mean, square, steps });
            }
        });
        Self { moments }
    }
}

/// The norm of all gradients together, after which they are no longer than `clip`.
pub(crate) fn clip_gradients(gradients: &mut [Option<Tensor<1>>], clip: Option<f64>) -> f32 {
    let squares: Vec<Tensor<1>> =
        gradients.iter().flatten().map(|gradient| gradient.clone().square().sum()).collect();
    if squares.is_empty() {
        return 0.0;
    }
    let norm = host(Tensor::cat(squares, 0).sum().sqrt())[0];
    // PyTorch's formula, with its 1e-6.
    let factor = clip.map_or(1.0, |clip| (clip / (f64::from(norm) + 1e-6)).min(1.0));
    if factor < 1.0 {
        for gradient in gradients.iter_mut().flatten() {
            *gradient = gradient.clone() * factor;
        }
    }
    norm
}
