//! The state of AdamW on a device: averages of many tensors end to end, so that a step is a handful of operations and
//! nothing comes back.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::OptimConfig;
use super::adamw::{AdamW, Moments, Rates};
use super::gradients::Joined;
use crate::params::{self, Spec};

/// The state of tensors that have taken the same number of steps.
pub(super) struct JoinedMoments {
    /// Their names, in the order of the network.
    names: Vec<String>,
    /// Values of each.
    sizes: Vec<usize>,
    mean: Tensor<1>,
    square: Tensor<1>,
    steps: u64,
}

impl JoinedMoments {
    /// The state of one tensor, `[N]` each.
    pub(super) fn of(&self, name: &str) -> Option<(Tensor<1>, Tensor<1>, u64)> {
        let index = self.names.iter().position(|known| known == name)?;
        let start = self.sizes[..index].iter().sum();
        let part = |all: &Tensor<1>| all.clone().narrow(0, start, self.sizes[index]);
        Some((part(&self.mean), part(&self.square), self.steps))
    }
}

impl AdamW {
    /// One step on the device.
    pub(super) fn step_joined<M: Module>(
        &mut self,
        network: M,
        gradients: &Joined,
        config: &OptimConfig,
        lr: f64,
    ) -> M {
        let (mut specs, mut weights) = (Vec::new(), Vec::new());
        let mut sizes = gradients.sizes.iter();
        params::visit(&network, |spec, weight| {
            if sizes.next().is_some_and(Option::is_some) {
                specs.push(spec.clone());
                weights.push(weight);
            }
        });
        let steps = self.steps_of(&specs);
        if let Some(other) = steps.iter().find(|count| **count != steps[0]).copied() {
            // Bias corrections differ: those of one number of steps, then the others.
            let changing: Vec<usize> =
                (0..).zip(&gradients.sizes).filter_map(|(index, size)| size.map(|_| index)).collect();
            let is_other =
                |index: usize| changing.binary_search(&index).is_ok_and(|place| steps[place] == other);
            let parts = [gradients.only(is_other), gradients.only(|index| !is_other(index))];
            return parts
                .iter()
                .flatten()
                .fold(network, |network, part| self.step_joined(network, part, config, lr));
        }
        let device = gradients.values.device();
        let mut moments = self.joined(&specs, steps[0], &device);
        moments.steps += 1;
        let rates = Rates::new(config, lr, moments.steps);
        let gradient = gradients.values.clone();
        let [mean, square] = [moments.mean, moments.square];
        moments.mean = mean * rates.beta_mean + gradient.clone() * rates.new_mean;
        moments.square = square * rates.beta_square + gradient.square() * rates.new_square;
        let below = moments.square.clone().sqrt() / rates.root + rates.epsilon;
        let weights = Tensor::cat(weights, 0) * rates.kept - moments.mean.clone() / below * rates.size;
        let (mut sizes, mut start) = (gradients.sizes.iter(), 0);
        let network = params::map(network, |_, weight| {
            let Some(size) = sizes.next().copied().flatten() else { return weight };
            start += size;
            weights.clone().narrow(0, start - size, size)
        });
        self.on_device.push(moments);
        network
    }

    /// How many steps each tensor has taken.
    fn steps_of(&self, specs: &[Spec]) -> Vec<u64> {
        // All tensors of a phase change in every step: the rule.
        if let Some(all) = self.on_device.iter().find(|joined| is_of(joined, specs)) {
            return vec![all.steps; specs.len()];
        }
        let steps = |spec: &Spec| {
            let joined = self.on_device.iter().find_map(|joined| joined.of(&spec.name));
            let on_host = || self.moments.get(&spec.name).map_or(0, |moments| moments.steps);
            joined.map_or_else(on_host, |(.., steps)| steps)
        };
        specs.iter().map(steps).collect()
    }

    /// Takes out the state of these tensors, end to end.
    fn joined(&mut self, specs: &[Spec], steps: u64, device: &Device) -> JoinedMoments {
        if let Some(index) = self.on_device.iter().position(|joined| is_of(joined, specs)) {
            return self.on_device.swap_remove(index);
        }
        let names: Vec<String> = specs.iter().map(|spec| spec.name.clone()).collect();
        let sizes: Vec<usize> = specs.iter().map(|spec| spec.shape.iter().product()).collect();
        let (mut means, mut squares) = (Vec::new(), Vec::new());
        for (name, &size) in names.iter().zip(&sizes) {
            let upload = |values: Vec<f32>| Tensor::<1>::from_data(TensorData::new(values, [size]), device);
            let (mean, square) = match self.on_device.iter().find_map(|joined| joined.of(name)) {
                Some((mean, square, _)) => (mean, square),
                None => match self.moments.remove(name) {
                    Some(Moments { mean, square, .. }) => (upload(mean), upload(square)),
                    None => (Tensor::zeros([size], device), Tensor::zeros([size], device)),
                },
            };
            means.push(mean);
            squares.push(square);
        }
        // What else their old companions hold stays, in pieces of one tensor.
        let old: Vec<JoinedMoments> = std::mem::take(&mut self.on_device);
        for joined in old {
            if !joined.names.iter().any(|name| names.contains(name)) {
                self.on_device.push(joined);
                continue;
            }
            for (name, &size) in
                joined.names.iter().zip(&joined.sizes).filter(|(name, _)| !names.contains(name))
            {
                let (mean, square, steps) = joined.of(name).expect("it has its own names");
                self.on_device.push(JoinedMoments {
                    names: vec![name.clone()],
                    sizes: vec![size],
                    mean,
                    square,
                    steps,
                });
            }
        }
        JoinedMoments { names, sizes, mean: Tensor::cat(means, 0), square: Tensor::cat(squares, 0), steps }
    }
}

fn is_of(joined: &JoinedMoments, specs: &[Spec]) -> bool {
    joined.names.len() == specs.len() && joined.names.iter().zip(specs).all(|(name, spec)| *name == spec.name)
}
