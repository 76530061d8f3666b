//! A linear map with a constant, by ridge regression.

use faer::linalg::solvers::Solve as _;
use faer::{Mat, MatRef, Side};

use super::{Samples, Scaling};

/// A linear map from latents to states.
///
/// Source: A. E. Hoerl and R. W. Kennard, "Ridge regression", Technometrics 12 (1970), by Cholesky factors of the covariance.
#[derive(Clone, Debug)]
pub struct LinearProbe {
    inputs: Scaling,
    outputs: Scaling,
    /// `[Z, S]`, between scaled numbers.
    weights: Mat<f64>,
}

impl LinearProbe {
    /// Fits it, with penalty `ridge` × N on the squared weights between scaled numbers; the constant is free. `None` without
    /// samples, and where the covariance is singular: raise `ridge`.
    pub fn fit(samples: &Samples, ridge: f64) -> Option<Self> {
        let count = samples.len();
        if count == 0 || samples.input_width == 0 {
            return None;
        }
        let inputs = Scaling::of(&samples.inputs, samples.input_width);
        let outputs = Scaling::of(&samples.outputs, samples.output_width);
        let (x, y) = (inputs.apply(&samples.inputs), outputs.apply(&samples.outputs));
        let x = MatRef::from_row_major_slice(&x, count, samples.input_width);
        let y = MatRef::from_row_major_slice(&y, count, samples.output_width);
        let mut covariance = x.transpose() * x;
        for index in 0..samples.input_width {
            covariance[(index, index)] += ridge * count as f64;
        }
        let mixed = x.transpose() * y;
        let factor = covariance.llt(Side::Lower).ok()?;
        let pivots = || (0..samples.input_width).map(|index| factor.L()[(index, index)]);
        // Smaller ones are the rounding of what was subtracted.
        if pivots().fold(f64::INFINITY, f64::min) <= 1e-7 * pivots().fold(0.0, f64::max) {
            return None;
        }
        let weights = factor.solve(&mixed);
        let is_finite = weights.col_iter().all(|column| column.iter().all(|weight| weight.is_finite()));
        is_finite.then_some(Self { inputs, outputs, weights })
    }

    /// What latents `[N, Z]` tell: `[N, S]`.
    pub fn tell(&self, latents: &[f64]) -> Vec<f64> {
        let (width, outputs) = (self.weights.nrows(), self.weights.ncols());
        let x = self.inputs.apply(latents);
        let told = MatRef::from_row_major_slice(&x, latents.len() / width, width) * &self.weights;
        let mut told: Vec<f64> = (0..told.nrows())
            .flat_map(|row| (0..outputs).map(move |column| (row, column)))
            .map(|at| told[at])
            .collect();
        self.outputs.undo(&mut told);
        told
    }
}

#[cfg(test)]
mod tests {
    use super::super::ProbeScore;
    use super::super::tests::samples;
    use super::*;

    #[test]
    fn it_finds_a_linear_map_and_ridge_shrinks_it() {
        let map = |z: [f64; 3]| [3.0 * z[0] - z[1] + 7.0, 0.5 * z[2]];
        let (fitted, scored) = (samples(60, 0.0, map), samples(40, 60.0, map));
        let score = |ridge: f64| {
            let told = LinearProbe::fit(&fitted, ridge).unwrap().tell(&scored.inputs);
            ProbeScore::of(&told, &scored.outputs, 2)
        };
        let exact = score(0.0);
        assert!(
            exact.mse.iter().all(|&mse| mse < 1e-20) && exact.mean_correlation().unwrap() > 0.999_999,
            "{exact:?}"
        );
        assert!(score(1.0).unexplained > Some(0.1));
        // One input: the slope between scaled numbers is 1 / (1 + λ).
        let single =
            Samples { input_width: 1, output_width: 1, inputs: vec![-1.0, 1.0], outputs: vec![-2.0, 2.0] };
        assert!((LinearProbe::fit(&single, 0.5).unwrap().tell(&[3.0])[0] - 4.0).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_fitted_is_said() {
        assert!(LinearProbe::fit(&Samples::default(), 1.0).is_none());
        let twice = Samples {
            input_width: 2,
            output_width: 1,
            inputs: vec![1.0, 1.0, 2.0, 2.0, 4.0, 4.0],
            outputs: vec![1.0, 2.0, 3.0],
        };
        assert!(LinearProbe::fit(&twice, 0.0).is_none(), "a singular covariance");
        assert!(LinearProbe::fit(&twice, 1e-4).is_some());
    }
}
