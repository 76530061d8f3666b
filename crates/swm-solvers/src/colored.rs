//! Noise that is correlated in time: white noise, filtered so that its power falls with frequency.
//!
//! Source: Timmer & König, *On generating power law noise* (1995), in the variant of the reference's iCEM: white noise
//! is filtered, and not sampled in the frequency domain. The filter multiplies frequency j/H by (j/H)^(-beta/2), and the
//! constant part like the lowest frequency. That is a circular convolution over the horizon, done as such: horizons
//! are short.

use serde::{Deserialize, Serialize};

/// Normalization of colored noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Normalize {
    /// Every sequence is divided by its own standard deviation over time, as in the reference: a nearly constant
    /// sequence becomes large.
    #[default]
    PerSequence,
    /// All are divided by the standard deviation that the filter gives to each value.
    Analytic,
}

/// Writes the filter for a horizon of `kernel.len()` to `kernel`.
pub(crate) fn fill_kernel(kernel: &mut [f32], beta: f64, normalize: Normalize) {
    let horizon = kernel.len();
    let weight = |j: usize| (j.min(horizon - j).max(1) as f64 / horizon as f64).powf(-0.5 * beta);
    let turn = std::f64::consts::TAU / horizon as f64;
    let value = |m: usize| -> f64 {
        (0..horizon).map(|j| weight(j) * (turn * (j * m % horizon) as f64).cos()).sum::<f64>()
    };
    let power: f64 = match normalize {
        // The scale of the filter drops out.
        Normalize::PerSequence => weight(0) * weight(0),
        Normalize::Analytic => (0..horizon).map(|m| value(m) * value(m)).sum(),
    };
    let scale = 1.0 / power.sqrt();
    for (m, out) in kernel.iter_mut().enumerate() {
        *out = (value(m) * scale) as f32;
    }
}

/// Filters `white`, `[H, D]`, over time into `out`, `[H, D]`.
pub(crate) fn color(kernel: &[f32], normalize: Normalize, white: &[f32], out: &mut [f32]) {
    let horizon = kernel.len();
    if horizon == 1 {
        out.copy_from_slice(white);
        return;
    }
    let dim = white.len() / horizon;
    out.fill(0.0);
    for (h, out) in out.chunks_exact_mut(dim).enumerate() {
        for (g, white) in white.chunks_exact(dim).enumerate() {
            let weight = kernel[if h < g { h + horizon - g } else { h - g }];
            out.iter_mut().zip(white).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    if normalize == Normalize::PerSequence {
        for d in 0..dim {
            let sequence = || out[d..].iter().step_by(dim);
            let mean = sequence().sum::<f32>() / horizon as f32;
            let squares: f32 = sequence().map(|value| (value - mean) * (value - mean)).sum();
            let std = (squares / (horizon - 1) as f32).sqrt().max(1e-8);
            out[d..].iter_mut().step_by(dim).for_each(|value| *value /= std);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution as _, StandardNormal};
    use swm_core::seed::keyed;

    use super::*;

    const COUNT: usize = 4000;

    /// `COUNT` sequences of `horizon` values, two by two.
    fn sequences(horizon: usize, beta: f64, normalize: Normalize) -> Vec<Vec<f64>> {
        let mut kernel = vec![0.0; horizon];
        fill_kernel(&mut kernel, beta, normalize);
        let mut stream = keyed(3, "coloured", [horizon as u64, 0]);
        let mut sequences = Vec::new();
        while sequences.len() < COUNT {
            let white: Vec<f32> = (0..2 * horizon).map(|_| StandardNormal.sample(&mut stream)).collect();
            let mut out = vec![0.0; 2 * horizon];
            color(&kernel, normalize, &white, &mut out);
            let sequence = |d| out[d..].iter().step_by(2).map(|&value| f64::from(value)).collect();
            sequences.extend([sequence(0), sequence(1)]);
        }
        sequences
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    /// The mean power of a sequence at frequency j/H.
    fn power(sequences: &[Vec<f64>], j: usize) -> f64 {
        let of = |sequence: &Vec<f64>| {
            let turn = std::f64::consts::TAU * j as f64 / sequence.len() as f64;
            let part = |wave: fn(f64) -> f64| -> f64 {
                sequence.iter().enumerate().map(|(h, value)| value * wave(turn * h as f64)).sum()
            };
            part(f64::cos).powi(2) + part(f64::sin).powi(2)
        };
        mean(&sequences.iter().map(of).collect::<Vec<_>>())
    }

    #[test]
    fn every_sequence_has_unit_std_over_time() {
        for (horizon, beta) in [(4, 2.0), (5, 0.0), (10, 2.0), (10, 0.5), (11, 3.0)] {
            for sequence in sequences(horizon, beta, Normalize::PerSequence) {
                let mean = mean(&sequence);
                let squares: f64 = sequence.iter().map(|value| (value - mean).powi(2)).sum();
                assert!((squares / (horizon - 1) as f64 - 1.0).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn white_sequences_of_unit_std_have_means_as_expected() {
        // E[mean²] = (1/H) (H-1)/(H-3): a scaled t distribution.
        let squares: Vec<f64> =
            sequences(10, 0.0, Normalize::PerSequence).iter().map(|s| mean(s).powi(2)).collect();
        assert!((mean(&squares) - 9.0 / 70.0).abs() < 0.01, "{}", mean(&squares));
    }

    #[test]
    fn power_falls_with_frequency() {
        for (beta, ratio) in [(0.0, 1.0), (1.0, 5.0), (2.0, 25.0)] {
            let sequences = sequences(10, beta, Normalize::Analytic);
            // The highest frequency has one wave and not two, and with it half of the degrees of freedom.
            let found = power(&sequences, 1) / power(&sequences, 5);
            assert!((found / ratio - 1.0).abs() < 0.1, "beta {beta}: {found}");
            assert!((power(&sequences, 0) / power(&sequences, 1) - 1.0).abs() < 0.1);
        }
    }

    #[test]
    fn analytic_noise_has_unit_variance_at_every_step() {
        for beta in [0.0, 1.0, 2.5] {
            let sequences = sequences(7, beta, Normalize::Analytic);
            for step in 0..7 {
                let squares: Vec<f64> = sequences.iter().map(|sequence| sequence[step].powi(2)).collect();
                assert!((mean(&squares) - 1.0).abs() < 0.1, "beta {beta}, step {step}: {}", mean(&squares));
            }
        }
    }

    #[test]
    fn one_step_is_white() {
        let squares: Vec<f64> =
            sequences(1, 2.0, Normalize::PerSequence).iter().map(|sequence| sequence[0].powi(2)).collect();
        assert!((mean(&squares) - 1.0).abs() < 0.1);
    }
}
