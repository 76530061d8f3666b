//! Steps on the device are those of the host, state that a file holds goes both ways, and gradients are bounded alike.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::{AdamW, Gradients, OptimConfig};
use crate::init::initialize;
use crate::layers::{LayerNorm, Linear};
use crate::params::{self, host};
use crate::placement::as_on_a_device;

#[derive(Module, Debug)]
struct Network {
    first: Linear,
    norm: LayerNorm,
    second: Linear,
}

fn network() -> Network {
    let device = Device::flex();
    let first = Linear::new(5, 7, &device);
    let second = Linear::without_bias(7, 3, &device);
    initialize(Network { first, norm: LayerNorm::new(7, &device), second }, 4)
}

/// The weights by name.
fn weights(network: &Network) -> BTreeMap<String, Vec<f32>> {
    let mut weights = BTreeMap::new();
    params::visit(network, |spec, tensor| drop(weights.insert(spec.name.clone(), host(tensor))));
    weights
}

/// Made-up gradients of step `step`, for the tensors that `of` names.
fn gradients(network: &Network, step: usize, of: impl Fn(&str) -> bool) -> Vec<Option<Tensor<1>>> {
    let mut gradients = Vec::new();
    params::visit(network, |spec, tensor| {
        let count = tensor.dims()[0];
        let start = 1000 * step + 100 * gradients.len();
        let values: Vec<f32> = (start..start + count).map(|index| (index as f32).sin()).collect();
        let gradient = Tensor::from_data(TensorData::new(values, [count]), &tensor.device());
        gradients.push(of(&spec.name).then_some(gradient));
    });
    gradients
}

type Of = fn(&str) -> bool;

/// Steps, of which some leave tensors out: first all, then part, then all, whose numbers of steps differ.
const STEPS: [Of; 5] =
    [|_| true, |name| name.starts_with("first"), |_| true, |_| true, |name| name != "norm.bias"];

fn optim() -> OptimConfig {
    OptimConfig { lr: 0.01, weight_decay: 0.1, ..OptimConfig::default() }
}

fn step(optimizer: &mut AdamW, network: Network, index: usize, clip: f64) -> (Network, f32) {
    let mut gradients = Gradients::new(gradients(&network, index, STEPS[index]));
    let norm = gradients.clip(Some(clip)).value();
    (optimizer.step(network, gradients, &optim(), 0.01), norm)
}

fn close(a: &BTreeMap<String, Vec<f32>>, b: &BTreeMap<String, Vec<f32>>) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    for ((name, a), b) in a.iter().zip(b.values()) {
        assert_eq!(a.len(), b.len(), "{name}");
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() < 1e-6, "{name}: {a} and {b}");
        }
    }
}

fn state(optimizer: &AdamW, network: &Network) -> BTreeMap<String, Vec<f32>> {
    optimizer.to_host(network).into_iter().map(|(name, _, values)| (name, values)).collect()
}

#[test]
fn a_device_steps_as_the_host_does() {
    // Norms are about 6: the first bound is exceeded, the other is not.
    for clip in [0.5, 100.0] {
        let (mut host, mut device) = ((AdamW::default(), network()), (AdamW::default(), network()));
        for index in 0..STEPS.len() {
            let (next, norm) = step(&mut host.0, host.1, index, clip);
            host.1 = next;
            let (next, norm_there) = as_on_a_device(|| step(&mut device.0, device.1, index, clip));
            device.1 = next;
            assert!((norm - norm_there).abs() < 1e-5 * norm, "{norm} and {norm_there}");
            close(&weights(&host.1), &weights(&device.1));
            close(&state(&host.0, &host.1), &state(&device.0, &device.1));
        }
        assert!(host.0.on_device.is_empty() && device.0.moments.is_empty());
        let moved = weights(&host.1)["first.weight"][0] - weights(&network())["first.weight"][0];
        assert!(moved.abs() > 0.01, "{moved}");
    }
}

#[test]
fn state_goes_from_the_host_to_a_device_and_back() {
    let mut straight = (AdamW::default(), network());
    for index in 0..STEPS.len() {
        straight.1 = step(&mut straight.0, straight.1, index, 0.5).0;
    }
    let mut moving = (AdamW::default(), network());
    for index in 0..STEPS.len() {
        let mut stored = state(&moving.0, &moving.1);
        moving.0 = AdamW::from_host(&moving.1, |name, count| {
            stored.remove(name).filter(|values| values.len() == count)
        });
        assert!(stored.is_empty(), "{:?}", stored.keys());
        let mut go = || step(&mut moving.0, moving.1.clone(), index, 0.5).0;
        moving.1 = if index % 2 == 0 { as_on_a_device(go) } else { go() };
    }
    close(&weights(&straight.1), &weights(&moving.1));
    close(&state(&straight.0, &straight.1), &state(&moving.0, &moving.1));
}

#[test]
fn parts_of_gradients_are_taken_out_alike() {
    let network = network();
    let of = |index: usize| index % 2 == 1;
    let taken = |gradients: Vec<Option<Tensor<1>>>| {
        let mut all = Gradients::new(gradients);
        let none = all.take(|_| false).clip(None).value();
        let mut part = all.take(of);
        let norms = [part.clip(None).value(), none];
        let changed = AdamW::default().step(network.clone(), part, &optim(), 0.01);
        (norms, weights(&changed))
    };
    let (norms, changed) = as_on_a_device(|| taken(gradients(&network, 0, |_| true)));
    let mut only: Vec<Option<Tensor<1>>> = gradients(&network, 0, |_| true);
    (0..).zip(&mut only).for_each(|(index, gradient)| drop(gradient.take_if(|_| !of(index))));
    let expected = Gradients::new(only.clone()).clip(None).value();
    assert!((norms[0] - expected).abs() < 1e-5 * expected && norms[1] == 0.0, "{norms:?}, {expected}");
    close(&changed, &weights(&AdamW::default().step(network.clone(), Gradients::new(only), &optim(), 0.01)));
}
