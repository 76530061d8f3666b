//! The functions of TD-MPC2 (Hansen, Su and Wang 2024, arXiv 2310.16828): values as distributions over bins, latents as
//! simplices, Gaussian policies squashed by tanh. Formulas are those of the reference's `wm/tdmpc2/module.py`.

use burn::tensor::activation::{log_softmax, relu, softmax};
use burn::tensor::{Tensor, TensorData};

pub(super) use swm_nn::mish;

/// Bounds of the logarithms of the policy's stds.
const LOG_STDS: [f64; 2] = [-10.0, 2.0];
/// Added to 1 − tanh² before its logarithm.
const SQUASH: f64 = 1e-6;

/// sign(x) ln(1 + |x|): compresses rewards and values of any scale (Hafner et al. 2023, arXiv 2301.04104).
pub(super) fn symlog(x: Tensor<2>) -> Tensor<2> {
    x.clone().sign() * (x.abs() + 1.0).log()
}

/// sign(x) (exp |x| − 1): the inverse of [`symlog`].
pub(super) fn symexp(x: Tensor<2>) -> Tensor<2> {
    x.clone().sign() * (x.abs().exp() - 1.0)
}

/// Equally spaced bins, on which numbers are distributions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bins {
    /// The first bin, in units of [`symlog`].
    pub(super) low: f64,
    /// The last one.
    pub(super) high: f64,
    /// K: 2 or more.
    pub(super) count: usize,
}

impl Bins {
    fn size(&self) -> f64 {
        (self.high - self.low) / (self.count - 1) as f64
    }

    /// `[1, K]` of `value(k)`, on the device of `like`.
    fn row(&self, value: impl Fn(usize) -> f64, like: &Tensor<2>) -> Tensor<2> {
        let values: Vec<f32> = (0..self.count).map(|bin| value(bin) as f32).collect();
        Tensor::from_data(TensorData::new(values, [1, self.count]), &like.device().inner())
    }

    /// The two-hot encoding of numbers, `[N, 1]` → `[N, K]`: the two bins next to symlog x share a weight of 1, linearly. Numbers
    /// beyond the last bin are in it.
    pub(super) fn two_hot(&self, x: Tensor<2>) -> Tensor<2> {
        let place = (symlog(x).clamp(self.low, self.high) - self.low) / self.size();
        let bins = self.row(|bin| bin as f64, &place);
        relu((place - bins).abs() * -1.0 + 1.0)
    }

    /// The number that logits stand for, `[N, K]` → `[N, 1]`: symexp(Σ softmax · bin).
    pub(super) fn number(&self, logits: Tensor<2>) -> Tensor<2> {
        let bins = self.row(|bin| self.low + bin as f64 * self.size(), &logits);
        symexp((softmax(logits, 1) * bins).sum_dim(1))
    }
}

/// The cross-entropy of each row of logits to a distribution, `[N, K]` both → `[N, 1]`.
pub(super) fn cross_entropy(logits: Tensor<2>, target: Tensor<2>) -> Tensor<2> {
    -(target * log_softmax(logits, 1)).sum_dim(1)
}

/// SimNorm: a softmax over each group of `group` values, `[N, Z]` → `[N, Z]`.
pub(super) fn simnorm(x: Tensor<2>, group: usize) -> Tensor<2> {
    let [rows, dim] = x.dims();
    softmax(x.reshape([rows, dim / group, group]), 2).reshape([rows, dim])
}

/// The log std of a policy from what its network says: −10 + 6 (tanh x + 1).
pub(super) fn log_std(x: Tensor<2>) -> Tensor<2> {
    let [low, high] = LOG_STDS;
    (x.tanh() + 1.0) * (0.5 * (high - low)) + low
}

/// The log density of a Gaussian at `noise` stds from its mean, summed over actions: `[N, A]` → `[N, 1]`.
pub(super) fn gaussian_log_density(noise: Tensor<2>, log_std: Tensor<2>) -> Tensor<2> {
    (noise.square() * -0.5 - log_std - 0.5 * (2.0 * std::f64::consts::PI).ln()).sum_dim(1)
}

/// The action tanh x of a Gaussian's sample x, `[N, A]`, and its log density, `[N, 1]`, from that of x.
pub(super) fn squash(x: Tensor<2>, log_density: Tensor<2>) -> [Tensor<2>; 2] {
    let action = x.tanh();
    let shrinks = (relu(action.clone().square() * -1.0 + 1.0) + SQUASH).log();
    [action, log_density - shrinks.sum_dim(1)]
}

/// The difference between the 95th and the 5th percentile, at least 1e-4: what the values of a policy's actions are divided by.
/// Percentiles are interpolated linearly, as by `torch.quantile`.
pub(super) fn percentile_range(mut values: Vec<f32>) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    let percentile = |share: f32| {
        let place = share * values.len().saturating_sub(1) as f32;
        let (below, above) = (place.floor() as usize, place.ceil() as usize);
        values[below] + (values[above] - values[below]) * (place - place.floor())
    };
    (percentile(0.95) - percentile(0.05)).max(1e-4)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use swm_nn::params::host;

    fn tensor<const N: usize>(values: [f32; N], shape: [usize; 2]) -> Tensor<2> {
        Tensor::from_data(TensorData::new(values.to_vec(), shape), &Device::flex())
    }

    fn is_near(tensor: Tensor<2>, wanted: &[f32]) {
        let found = host(tensor);
        let near = found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near && found.len() == wanted.len(), "{found:?} instead of {wanted:?}");
    }

    #[test]
    fn symlog_and_symexp_are_inverse() {
        let e = std::f32::consts::E;
        is_near(symlog(tensor([0.0, e - 1.0, 1.0 - e * e], [3, 1])), &[0.0, 1.0, -2.0]);
        is_near(symexp(tensor([0.0, 1.0, -2.0], [3, 1])), &[0.0, e - 1.0, 1.0 - e * e]);
    }

    #[test]
    fn two_bins_share_a_number() {
        let bins = Bins { low: -2.0, high: 2.0, count: 5 };
        let at = |symlog: f32| symlog.signum() * (symlog.abs().exp() - 1.0);
        let numbers = tensor([0.0, at(0.25), at(-1.5), 1e6, -1e6], [5, 1]);
        let wanted = [
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.75, 0.25, 0.0],
            [0.5, 0.5, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 0.0, 0.0],
        ];
        is_near(bins.two_hot(numbers), &wanted.concat());
        // Logarithms of the weights are logits of the same number.
        let log = |weight: f32| weight.max(1e-12).ln();
        is_near(bins.number(tensor(wanted[1].map(log), [1, 5])), &[at(0.25)]);
        // All bins alike: the middle.
        is_near(bins.number(tensor([3.0; 5], [1, 5])), &[0.0]);
    }

    #[test]
    fn groups_are_simplices() {
        let x = tensor([0.0, 3.0_f32.ln(), 5.0, 5.0], [1, 4]);
        is_near(simnorm(x, 2), &[0.25, 0.75, 0.5, 0.5]);
    }

    #[test]
    fn mish_needs_one_exponential() {
        let x: [f32; 6] = [-30.0, -1.0, 0.0, 0.5, 19.9, 100.0];
        let wanted = x.map(|x| x * f64::from(x).exp().ln_1p().tanh() as f32);
        is_near(mish(tensor(x, [6, 1])), &wanted);
    }

    #[test]
    fn a_squashed_density_integrates_to_one() {
        // Actions a = tanh x of x ~ N(0.3, e^-0.5): Σ p(a) da over x, da = (1 − a²) dx.
        let (mean, log_std, step) = (0.3_f32, -0.5_f32, 0.01);
        let x: Vec<f32> = (-600..600).map(|index| index as f32 * step).collect();
        let noise: Vec<f32> = x.iter().map(|x| (x - mean) / log_std.exp()).collect();
        let column =
            |values: Vec<f32>| Tensor::<2>::from_data(TensorData::new(values, [1200, 1]), &Device::flex());
        let density = gaussian_log_density(column(noise), column(vec![log_std; 1200]));
        let [action, density] = squash(column(x), density);
        let area = host(density.exp() * (action.square() * -1.0 + 1.0) * step);
        assert!((area.iter().sum::<f32>() - 1.0).abs() < 1e-2, "{}", area.iter().sum::<f32>());
    }

    #[test]
    fn percentiles_are_interpolated() {
        // 0 … 20: the 5th percentile is 1, the 95th 19.
        assert!((percentile_range((0..=20).rev().map(|value| value as f32).collect()) - 18.0).abs() < 1e-5);
        // 0 … 10: 0.5 and 9.5.
        assert!((percentile_range((0..=10).map(|value| value as f32).collect()) - 9.0).abs() < 1e-5);
        assert!((percentile_range(vec![2.0; 7]) - 1e-4).abs() < 1e-9);
    }
}
