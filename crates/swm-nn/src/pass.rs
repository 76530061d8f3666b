//! The context of a forward pass: whether it trains, its noise, and the statistics that it gathers.
//!
//! On a CPU no global generator decides anything: the noise of a step is a function of (seed, step, index of the sample).
//! Other devices use their own generator, which each step seeds anew from (seed, step): the same noise on the same kind of
//! device, as long as one training at a time uses it.

use burn::module::ParamId;
use burn::tensor::{Device, Distribution, Tensor, TensorData};
use rand::RngExt as _;
use rand_distr::StandardNormal;
use swm_core::seed::keyed;

use crate::placement::Placement;

/// One forward pass.
pub struct Pass {
    noise: Option<Noise>,
    /// The share of this batch in running statistics; `None`: they are used, and stay.
    batch_share: Option<f32>,
    /// New running statistics, by the tensor that holds them.
    pub statistics: Vec<(ParamId, Tensor<1>)>,
    /// What [`Pass::normal`] shall give, for comparisons with other implementations.
    #[cfg(any(test, feature = "testing"))]
    pub given: Vec<Vec<f32>>,
}

/// Where the noise of a step comes from.
enum Noise {
    /// Streams of the host, one for each sample.
    Keyed { seed: u64, step: u64, samples: u64 },
    /// The device's generator.
    Generator,
}

impl Pass {
    /// As when a trained model is used: no dropout, running statistics. A loss that needs noise samples it from `seed`.
    pub fn evaluate() -> Self {
        Self::new(None, None)
    }

    /// To estimate statistics anew, as a trained model is used but for them: those of this batch count as much as those of
    /// each of the `before` batches.
    pub fn statistics(before: u64) -> Self {
        Self::new(None, Some(1.0 / (before + 1) as f32))
    }

    /// As in step `step` of a training with this seed, on this device.
    pub fn train_on(device: &Device, seed: u64, step: u64) -> Self {
        if Placement::of(device) == Placement::Host {
            return Self::train(seed, step);
        }
        device.clone().inner().seed(keyed(seed, PURPOSE, [step, 0]).random());
        Self::new(Some(Noise::Generator), Some(RUNNING_SHARE))
    }

    /// As in step `step` of a training with this seed, on a CPU.
    pub fn train(seed: u64, step: u64) -> Self {
        Self::new(Some(Noise::Keyed { seed, step, samples: 0 }), Some(RUNNING_SHARE))
    }

    fn new(noise: Option<Noise>, batch_share: Option<f32>) -> Self {
        Self {
            noise,
            batch_share,
            statistics: Vec::new(),
            #[cfg(any(test, feature = "testing"))]
            given: Vec::new(),
        }
    }

    /// Whether dropout is in use.
    pub fn is_training(&self) -> bool {
        self.noise.is_some()
    }

    /// The share of the batch in running statistics, if its own are in use.
    pub fn batch_share(&self) -> Option<f32> {
        self.batch_share
    }

    /// What `forward` computes, whose batches leave no trace in running statistics.
    pub fn untold<T>(&mut self, forward: impl FnOnce(&mut Self) -> T) -> T {
        let told = std::mem::take(&mut self.statistics);
        let output = forward(self);
        self.statistics = told;
        output
    }

    /// Zeroes a share `rate` of the values and scales the others up, in training.
    pub fn dropout<const D: usize>(&mut self, input: Tensor<D>, rate: f64) -> Tensor<D> {
        if rate == 0.0 {
            return input;
        }
        let Some(noise) = &mut self.noise else { return input };
        let (shape, device) = (input.dims(), input.device().inner());
        let Some(mut stream) = noise.next_stream() else {
            let kept = Tensor::<D>::random(shape, Distribution::Bernoulli(1.0 - rate), &device);
            let kept = kept * (1.0 / (1.0 - rate));
            let precision = input.dtype();
            return input * kept.cast(precision);
        };
        let mut values = vec![0.0; shape.iter().product()];
        let (threshold, scale) = ((rate * 65536.0).round() as u16, (1.0 / (1.0 - rate)) as f32);
        for pair in values.chunks_mut(4) {
            let word: u64 = stream.random();
            for (value, part) in pair.iter_mut().zip(0..) {
                *value = if ((word >> (16 * part)) as u16) < threshold { 0.0 } else { scale };
            }
        }
        let precision = input.dtype();
        input * Tensor::<D>::from_data(TensorData::new(values, shape), &device).cast(precision)
    }

    /// Standard normal values. Outside training they are those of step 0 of seed 0, so that a validation loss
    /// does not jitter.
    pub fn normal<const D: usize>(&mut self, shape: [usize; D], device: &Device) -> Tensor<D> {
        #[cfg(any(test, feature = "testing"))]
        if let Some(values) = self.given.pop() {
            return Tensor::from_data(TensorData::new(values, shape), &device.clone().inner());
        }
        let stream = match &mut self.noise {
            Some(noise) => noise.next_stream(),
            None => Some(keyed(0, PURPOSE, [0, 0])),
        };
        let Some(mut stream) = stream else {
            return Tensor::random(shape, Distribution::Normal(0.0, 1.0), &device.clone().inner());
        };
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| stream.sample(StandardNormal)).collect();
        Tensor::from_data(TensorData::new(values, shape), &device.clone().inner())
    }
}

const PURPOSE: &str = "baseline noise";
/// PyTorch's `momentum` of batch normalization.
const RUNNING_SHARE: f32 = 0.1;

impl Noise {
    /// The stream of the next sample; `None` where the device has the generator.
    fn next_stream(&mut self) -> Option<swm_core::seed::Stream> {
        let Self::Keyed { seed, step, samples } = self else { return None };
        let stream = keyed(*seed, PURPOSE, [*step, *samples]);
        *samples += 1;
        Some(stream)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::host;
    use crate::placement::as_on_a_device;

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
    fn a_devices_generator_gives_the_noise_of_a_step_again() {
        let device = Device::flex();
        as_on_a_device(|| {
            let sample = |seed, step| {
                let mut pass = Pass::train_on(&device, seed, step);
                let normal = host(pass.normal([20_000], &device));
                (normal, host(pass.dropout(Tensor::<1>::ones([40_000], &device), 0.1)))
            };
            let (normal, kept) = sample(1, 2);
            assert_eq!((&normal, &kept), (&sample(1, 2).0, &sample(1, 2).1));
            assert!(sample(1, 3) != (normal.clone(), kept.clone()) && sample(2, 2).0 != normal);
            let mean = normal.iter().sum::<f32>() / 20_000.0;
            let variance = normal.iter().map(|value| value * value).sum::<f32>() / 20_000.0;
            assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean}, {variance}");
            let zeros = kept.iter().filter(|value| **value == 0.0).count();
            assert!((3_700..4_300).contains(&zeros), "{zeros}");
            assert!((kept.iter().sum::<f32>() / 40_000.0 - 1.0).abs() < 0.02);
        });
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
