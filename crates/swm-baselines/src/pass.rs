//! The context of a forward pass: whether it trains, its noise, and the statistics that it gathers.
//!
//! No global generator decides anything: the noise of a step is a function of (seed, step, index of the sample).

use burn::module::ParamId;
use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::seed::keyed;

/// One forward pass.
pub(crate) struct Pass {
    noise: Option<Noise>,
    /// The share of this batch in running statistics; `None`: they are used, and stay.
    batch_share: Option<f32>,
    /// New running statistics, by the tensor that holds them.
    pub(crate) statistics: Vec<(ParamId, Tensor<1>)>,
    /// What [`Pass::normal`] shall give, for comparisons with other implementations.
    #[cfg(test)]
    pub(crate) given: Vec<Vec<f32>>,
}

/// Where the noise of a step comes from.
struct Noise {
    seed: u64,
    step: u64,
    samples: u64,
}

impl Pass {
    /// As when a trained model is used: no dropout, running statistics. A loss that needs noise samples it from `seed`.
    pub(crate) fn evaluate() -> Self {
        Self::new(None, None)
    }

    /// To estimate statistics anew, as a trained model is used but for them: those of this batch count as much as those of
    /// each of the `before` batches.
    pub(crate) fn statistics(before: u64) -> Self {
        Self::new(None, Some(1.0 / (before + 1) as f32))
    }

    /// As in step `step` of a training with this seed.
    pub(crate) fn train(seed: u64, step: u64) -> Self {
        Self::new(Some(Noise { seed, step, samples: 0 }), Some(RUNNING_SHARE))
    }

    fn new(noise: Option<Noise>, batch_share: Option<f32>) -> Self {
        Self {
            noise,
            batch_share,
            statistics: Vec::new(),
            #[cfg(test)]
            given: Vec::new(),
        }
    }

    /// Whether dropout is in use.
    pub(crate) fn is_training(&self) -> bool {
        self.noise.is_some()
    }

    /// The share of the batch in running statistics, if its own are in use.
    pub(crate) fn batch_share(&self) -> Option<f32> {
        self.batch_share
    }

    /// What `forward` computes, whose batches leave no trace in running statistics.
    pub(crate) fn untold<T>(&mut self, forward: impl FnOnce(&mut Self) -> T) -> T {
        let told = std::mem::take(&mut self.statistics);
        let output = forward(self);
        self.statistics = told;
        output
    }

    /// Zeroes a share `rate` of the values and scales the others up, in training.
    pub(crate) fn dropout<const D: usize>(&mut self, input: Tensor<D>, rate: f64) -> Tensor<D> {
        if rate == 0.0 {
            return input;
        }
        let Some(noise) = &mut self.noise else { return input };
        let mut stream = noise.next_stream();
        let shape = input.dims();
        let mut values = vec![0.0; shape.iter().product()];
        let (threshold, scale) = ((rate * 65536.0).round() as u16, (1.0 / (1.0 - rate)) as f32);
        for pair in values.chunks_mut(4) {
            let word: u64 = stream.random();
            for (value, part) in pair.iter_mut().zip(0..) {
                *value = if ((word >> (16 * part)) as u16) < threshold { 0.0 } else { scale };
            }
        }
        let device = input.device().inner();
        input * Tensor::from_data(TensorData::new(values, shape), &device)
    }

    /// Standard normal values. Outside training they are those of step 0 of seed 0, so that a validation loss
    /// does not jitter.
    pub(crate) fn normal<const D: usize>(&mut self, shape: [usize; D], device: &Device) -> Tensor<D> {
        #[cfg(test)]
        if let Some(values) = self.given.pop() {
            return Tensor::from_data(TensorData::new(values, shape), &device.clone().inner());
        }
        let mut stream = match &mut self.noise {
            Some(noise) => noise.next_stream(),
            None => keyed(0, PURPOSE, [0, 0]),
        };
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| stream.sample(StandardNormal)).collect();
        Tensor::from_data(TensorData::new(values, shape), &device.clone().inner())
    }
}

const PURPOSE: &str = "baseline noise";
/// PyTorch's `momentum` of batch normalization.
const RUNNING_SHARE: f32 = 0.1;

impl Noise {
    fn next_stream(&mut self) -> swm_core::seed::Stream {
        let stream = keyed(self.seed, PURPOSE, [self.step, self.samples]);
        self.samples += 1;
        stream
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::host;

    #[test]
    fn noise_depends_on_seed_step_and_sample_alone() {
        let device = Device::flex();
        let sample = |seed, step, skip: usize| {
            let mut pass = Pass::train(seed, step);
            (0..skip).for_each(|_| drop(pass.normal([2], &device)));
            host(pass.normal([3], &device))
        };
        assert_eq!(sample(1, 2, 0), sample(1, 2, 0));
        assert!(
            [sample(2, 2, 0), sample(1, 3, 0), sample(1, 2, 1)].iter().all(|other| *other != sample(1, 2, 0))
        );
    }

    #[test]
    fn dropout_keeps_the_mean_and_is_off_outside_training() {
        let ones = Tensor::<1>::ones([40_000], &Device::flex());
        let kept = host(Pass::train(7, 0).dropout(ones.clone(), 0.1));
        let zeros = kept.iter().filter(|value| **value == 0.0).count();
        assert!((3_700..4_300).contains(&zeros), "{zeros}");
        assert!((kept.iter().sum::<f32>() / 40_000.0 - 1.0).abs() < 0.02);
        assert!(host(Pass::evaluate().dropout(ones, 0.1)).iter().all(|value| *value == 1.0));
    }
}
