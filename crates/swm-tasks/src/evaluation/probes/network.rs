//! A network of one hidden layer, trained by Adam for a fixed number of steps. Small, sequential, and the same on every
//! machine: a yardstick for latents, no model of its own.

use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use swm_core::seed::keyed;

use super::{Samples, Scaling};

/// Units of the hidden layer, samples per step, and steps.
const HIDDEN: usize = 64;
const BATCH: usize = 64;
const STEPS: usize = 2000;
/// Adam's step at the beginning (it falls to zero along a line), and its other parameters as published: D. P. Kingma and
/// J. Ba, "Adam" (2015).
const RATE: f64 = 3e-3;
const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// A map from latents to states by way of 64 rectified units.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkProbe {
    inputs: Scaling,
    outputs: Scaling,
    shape: Shape,
    /// One after another: weights `[HIDDEN, Z]`, biases `[HIDDEN]`, weights `[S, HIDDEN]`, biases `[S]`.
    parameters: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Shape {
    inputs: usize,
    outputs: usize,
}

impl Shape {
    fn count(self) -> usize {
        HIDDEN * (self.inputs + 1) + self.outputs * (HIDDEN + 1)
    }

    /// The four parts of the parameters, or of their gradient.
    fn parts(self, parameters: &[f64]) -> [&[f64]; 4] {
        let (first, rest) = parameters.split_at(HIDDEN * self.inputs);
        let (first_bias, rest) = rest.split_at(HIDDEN);
        let (second, second_bias) = rest.split_at(self.outputs * HIDDEN);
        [first, first_bias, second, second_bias]
    }

    fn parts_mut(self, parameters: &mut [f64]) -> [&mut [f64]; 4] {
        let (first, rest) = parameters.split_at_mut(HIDDEN * self.inputs);
        let (first_bias, rest) = rest.split_at_mut(HIDDEN);
        let (second, second_bias) = rest.split_at_mut(self.outputs * HIDDEN);
        [first, first_bias, second, second_bias]
    }

    /// Hidden values and outputs of one input.
    fn tell(self, parameters: &[f64], input: &[f64], hidden: &mut [f64; HIDDEN], output: &mut [f64]) {
        let [first, first_bias, second, second_bias] = self.parts(parameters);
        for ((unit, weights), bias) in hidden.iter_mut().zip(first.chunks_exact(self.inputs)).zip(first_bias)
        {
            *unit = (dot(weights, input) + bias).max(0.0);
        }
        for ((value, weights), bias) in output.iter_mut().zip(second.chunks_exact(HIDDEN)).zip(second_bias) {
            *value = dot(weights, hidden) + bias;
        }
    }

    /// Adds the gradient of half the squared error, whose gradient by the outputs is `error`.
    fn add_gradient(
        self,
        parameters: &[f64],
        input: &[f64],
        hidden: &[f64; HIDDEN],
        error: &[f64],
        gradient: &mut [f64],
    ) {
        let [_, _, second, _] = self.parts(parameters);
        let [first_gradient, first_bias, second_gradient, second_bias] = self.parts_mut(gradient);
        let mut back = [0.0; HIDDEN];
        for (index, &error) in error.iter().enumerate() {
            let row = index * HIDDEN..(index + 1) * HIDDEN;
            add_scaled(&mut second_gradient[row.clone()], hidden, error);
            add_scaled(&mut back, &second[row], error);
            second_bias[index] += error;
        }
        for (unit, back) in back.into_iter().enumerate().filter(|(unit, _)| hidden[*unit] > 0.0) {
            add_scaled(&mut first_gradient[unit * self.inputs..][..self.inputs], input, back);
            first_bias[unit] += back;
        }
    }
}

/// The sum of products, in eight strands: the order is fixed, and a CPU can take it eight at a time.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut strands = [0.0; 8];
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for ((sum, a), b) in strands.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    strands.iter().sum::<f64>() + rest
}

fn add_scaled(sums: &mut [f64], values: &[f64], factor: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

impl NetworkProbe {
    /// Trains it from weights, and in an order, that `seed` draws.
    pub fn fit(samples: &Samples, seed: u64) -> Self {
        let shape = Shape { inputs: samples.input_width, outputs: samples.output_width };
        let inputs = Scaling::of(&samples.inputs, shape.inputs);
        let outputs = Scaling::of(&samples.outputs, shape.outputs);
        let (x, y) = (inputs.apply(&samples.inputs), outputs.apply(&samples.outputs));
        let mut rng = keyed(seed, "network probe", [shape.inputs as u64, shape.outputs as u64]);
        let mut parameters = vec![0.0; shape.count()];
        let [first, _, second, _] = shape.parts_mut(&mut parameters);
        // Uniform with the variance 2 / inputs of rectified units (He et al., 2015), and 1 / inputs of linear ones.
        let bounds = [(6.0 / shape.inputs.max(1) as f64).sqrt(), (3.0 / HIDDEN as f64).sqrt()];
        first.fill_with(|| rng.random_range(-bounds[0]..bounds[0]));
        second.fill_with(|| rng.random_range(-bounds[1]..bounds[1]));
        let mut order: Vec<usize> = (0..samples.len()).collect();
        let (mut next, mut adam) = (order.len(), Adam::new(shape.count()));
        let mut gradient = vec![0.0; shape.count()];
        let (mut hidden, mut output) = ([0.0; HIDDEN], vec![0.0; shape.outputs]);
        for step in 0..STEPS {
            gradient.fill(0.0);
            let batch = BATCH.min(order.len());
            for _ in 0..batch {
                if next == order.len() {
                    order.shuffle(&mut rng);
                    next = 0;
                }
                let sample = order[next];
                next += 1;
                let input = &x[sample * shape.inputs..][..shape.inputs];
                shape.tell(&parameters, input, &mut hidden, &mut output);
                for (told, truth) in output.iter_mut().zip(&y[sample * shape.outputs..][..shape.outputs]) {
                    *told = (*told - truth) / batch as f64;
                }
                shape.add_gradient(&parameters, input, &hidden, &output, &mut gradient);
            }
            let rate = RATE * (1.0 - step as f64 / STEPS as f64);
            adam.step(&mut parameters, &gradient, rate);
        }
        Self { inputs, outputs, shape, parameters }
    }

    /// What latents `[N, Z]` tell: `[N, S]`.
    pub fn tell(&self, latents: &[f64]) -> Vec<f64> {
        let (x, mut hidden) = (self.inputs.apply(latents), [0.0; HIDDEN]);
        let mut told = vec![0.0; x.len() / self.shape.inputs.max(1) * self.shape.outputs];
        let rows = x.chunks_exact(self.shape.inputs.max(1));
        for (input, output) in rows.zip(told.chunks_exact_mut(self.shape.outputs.max(1))) {
            self.shape.tell(&self.parameters, input, &mut hidden, output);
        }
        self.outputs.undo(&mut told);
        told
    }
}

struct Adam {
    taken: i32,
    /// Running means of gradients and of their squares.
    means: Vec<f64>,
    squares: Vec<f64>,
}

impl Adam {
    fn new(count: usize) -> Self {
        Self { taken: 0, means: vec![0.0; count], squares: vec![0.0; count] }
    }

    fn step(&mut self, parameters: &mut [f64], gradient: &[f64], rate: f64) {
        self.taken += 1;
        let [first, second] = BETAS.map(|beta| 1.0 - beta.powi(self.taken));
        let moments = self.means.iter_mut().zip(&mut self.squares);
        for ((number, derivative), (mean, square)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *mean += (1.0 - BETAS[0]) * (derivative - *mean);
            *square += (1.0 - BETAS[1]) * (derivative * derivative - *square);
            *number -= rate * (*mean / first) / ((*square / second).sqrt() + EPSILON);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ProbeScore;
    use super::super::tests::samples;
    use super::*;

    #[test]
    fn gradients_are_those_of_the_error() {
        let shape = Shape { inputs: 3, outputs: 2 };
        let parameters: Vec<f64> = (0..shape.count()).map(|k| (k as f64 * 0.37).sin()).collect();
        let (input, truth) = ([0.3, -0.8, 0.5], [0.2, -1.0]);
        let error = |parameters: &[f64]| {
            let (mut hidden, mut output) = ([0.0; HIDDEN], [0.0; 2]);
            shape.tell(parameters, &input, &mut hidden, &mut output);
            output.iter().zip(truth).map(|(told, truth)| (told - truth) * (told - truth) / 2.0).sum::<f64>()
        };
        let (mut hidden, mut output, mut gradient) = ([0.0; HIDDEN], [0.0; 2], vec![0.0; shape.count()]);
        shape.tell(&parameters, &input, &mut hidden, &mut output);
        output.iter_mut().zip(truth).for_each(|(told, truth)| *told -= truth);
        shape.add_gradient(&parameters, &input, &hidden, &output, &mut gradient);
        for index in 0..shape.count() {
            let mut moved = parameters.clone();
            moved[index] += 1e-5;
            let ahead = error(&moved);
            moved[index] -= 2e-5;
            let derivative = (ahead - error(&moved)) / 2e-5;
            assert!(
                (derivative - gradient[index]).abs() < 1e-6 * (1.0 + derivative.abs()),
                "{index}: {derivative} {}",
                gradient[index]
            );
        }
    }

    #[test]
    fn it_finds_what_no_line_can() {
        let map = |z: [f64; 3]| [z[0] * z[1], 100.0 * z[2].abs()];
        let (fitted, scored) = (samples(400, 0.0, map), samples(100, 400.0, map));
        let probe = NetworkProbe::fit(&fitted, 5);
        let score = ProbeScore::of(&probe.tell(&scored.inputs), &scored.outputs, 2);
        assert!(score.unexplained.unwrap() < 0.05, "{score:?}");
        assert_eq!(probe, NetworkProbe::fit(&fitted, 5), "the same every time");
        #[cfg(feature = "faer")]
        {
            let line = super::super::LinearProbe::fit(&fitted, 1e-4).unwrap();
            let line = ProbeScore::of(&line.tell(&scored.inputs), &scored.outputs, 2);
            assert!(line.unexplained.unwrap() > 0.8, "{line:?}");
        }
    }
}
