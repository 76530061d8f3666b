//! How good a world model is without control: open-loop prediction by horizon, probes of the true state, surprise at what
//! cannot be. Over a small trait, which learned, analytic and simulated models implement alike.

use crate::batch::{Batch, Row};
use crate::error::BoxError;

use super::stats::correlation;

/// A model of the world in a latent space, as far as its quality can be measured from recorded rows.
pub trait WorldModel {
    /// Z: numbers of a latent.
    fn latent_width(&self) -> usize;

    /// Writes the latent `[Z]` of a row.
    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError>;

    /// Replaces the latent `[Z]` by what follows it under the action `[A]`.
    fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError>;
}

/// Mean squared error per number of the latent after 1, 2, … `horizon` predicted steps, `[horizon]`: open loop from every row
/// of the recorded episodes (each a table with the column `action`) from which so many follow. `None` where none do.
pub fn open_loop_error(
    model: &mut dyn WorldModel,
    episodes: &[Batch],
    horizon: usize,
) -> Result<Option<Vec<f64>>, BoxError> {
    let width = model.latent_width();
    let (mut sums, mut count) = (vec![0.0; horizon], 0_usize);
    for rows in episodes {
        let action = rows.schema().require("action")?;
        let latents = encode_all(model, rows)?;
        for start in 0..rows.rows().saturating_sub(horizon) {
            let mut latent = latents[start].clone();
            for (step, sum) in sums.iter_mut().enumerate() {
                model.predict(&mut latent, &numbers(rows.row(start + step), action))?;
                *sum += squared(&latent, &latents[start + step + 1]) / width as f64;
            }
            count += 1;
        }
    }
    Ok((count > 0).then(|| sums.into_iter().map(|sum| sum / count as f64).collect()))
}

/// How surprised a model is by each row of an episode after the first, `[T - 1]`: squared error of its prediction from the
/// row before, per number. Rows that cannot follow (something vanished, or is elsewhere) should stand out.
pub fn surprise(model: &mut dyn WorldModel, rows: &Batch) -> Result<Vec<f64>, BoxError> {
    let (width, action) = (model.latent_width(), rows.schema().require("action")?);
    let latents = encode_all(model, rows)?;
    (1..rows.rows())
        .map(|row| {
            let mut latent = latents[row - 1].clone();
            model.predict(&mut latent, &numbers(rows.row(row - 1), action))?;
            Ok(squared(&latent, &latents[row]) / width as f64)
        })
        .collect()
}

/// The share of pairs in which the impossible episode surprises more, at its worst row, than the possible one: 0.5 is chance.
/// `None` without pairs.
pub fn violation_accuracy(pairs: &[[Vec<f64>; 2]]) -> Option<f64> {
    let worst = |surprise: &[f64]| surprise.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let score = |[possible, impossible]: &[Vec<f64>; 2]| {
        let (a, b) = (worst(possible), worst(impossible));
        if a < b { 1.0 } else { f64::from(u8::from(a == b)) / 2.0 }
    };
    (!pairs.is_empty()).then(|| pairs.iter().map(score).sum::<f64>() / pairs.len() as f64)
}

fn encode_all(model: &mut dyn WorldModel, rows: &Batch) -> Result<Vec<Vec<f64>>, BoxError> {
    (0..rows.rows())
        .map(|row| {
            let mut latent = vec![0.0; model.latent_width()];
            model.encode(rows.row(row), &mut latent)?;
            Ok(latent)
        })
        .collect()
}

fn numbers(row: Row<'_>, column: usize) -> Vec<f64> {
    let values = row.at(column);
    (0..values.len()).map(|index| values.number(index).unwrap_or(f64::NAN)).collect()
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// A linear map from latents to states, with a constant, by ridge regression.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearProbe {
    /// `[S, Z]`.
    weights: Vec<Vec<f64>>,
    mean_latent: Vec<f64>,
    mean_state: Vec<f64>,
}

/// How well a probe tells one number of the state, on data that it was not fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeScore {
    /// Mean squared error.
    pub mse: f64,
    /// Pearson's correlation of prediction and truth; `None` where one is constant.
    pub correlation: Option<f64>,
}

impl LinearProbe {
    /// Fits a probe to `latents`, `[N, Z]`, and `states`, `[N, S]`, with penalty `ridge` × N on the squared weights; the
    /// constant is free. `None` for no data, rows of different lengths, or latents whose covariance is singular: raise
    /// `ridge`.
    ///
    /// Source: A. E. Hoerl and R. W. Kennard, "Ridge regression", Technometrics 12 (1970), by Cholesky factors.
    pub fn fit(latents: &[Vec<f64>], states: &[Vec<f64>], ridge: f64) -> Option<Self> {
        let count = latents.len();
        let (width, outputs) = (latents.first()?.len(), states.first()?.len());
        let fits =
            latents.iter().all(|row| row.len() == width) && states.iter().all(|row| row.len() == outputs);
        if states.len() != count || !fits {
            return None;
        }
        let (mean_latent, mean_state) = (means(latents), means(states));
        let mut gram = vec![0.0; width * width];
        let mut mixed = vec![vec![0.0; width]; outputs];
        for (latent, state) in latents.iter().zip(states) {
            let centred: Vec<f64> = latent.iter().zip(&mean_latent).map(|(x, mean)| x - mean).collect();
            for (row, &a) in centred.iter().enumerate() {
                gram[row * width..(row + 1) * width]
                    .iter_mut()
                    .zip(&centred)
                    .for_each(|(sum, b)| *sum += a * b);
            }
            for ((mixed, &y), mean) in mixed.iter_mut().zip(state).zip(&mean_state) {
                mixed.iter_mut().zip(&centred).for_each(|(sum, x)| *sum += x * (y - mean));
            }
        }
        (0..width).for_each(|index| gram[index * width + index] += ridge * count as f64);
        cholesky(&mut gram, width).then(|| {
            mixed.iter_mut().for_each(|side| solve(&gram, width, side));
            Self { weights: mixed, mean_latent, mean_state }
        })
    }

    /// Number `output` of the state behind a latent `[Z]`.
    pub fn predict(&self, latent: &[f64], output: usize) -> f64 {
        let terms = self.weights[output].iter().zip(latent).zip(&self.mean_latent);
        terms.map(|((weight, x), mean)| weight * (x - mean)).sum::<f64>() + self.mean_state[output]
    }

    /// A score per number of the state, `[S]`.
    pub fn score(&self, latents: &[Vec<f64>], states: &[Vec<f64>]) -> Vec<ProbeScore> {
        let score = |output: usize| {
            let told: Vec<f64> = latents.iter().map(|latent| self.predict(latent, output)).collect();
            let truth: Vec<f64> = states.iter().map(|state| state[output]).collect();
            let mse = squared(&told, &truth) / truth.len().max(1) as f64;
            ProbeScore { mse, correlation: correlation(&told, &truth) }
        };
        (0..self.weights.len()).map(score).collect()
    }
}

fn means(rows: &[Vec<f64>]) -> Vec<f64> {
    let width = rows.first().map_or(0, Vec::len);
    (0..width).map(|index| rows.iter().map(|row| row[index]).sum::<f64>() / rows.len() as f64).collect()
}

/// The lower Cholesky factor of a symmetric matrix `[n, n]`, in its place; false if it is not positive definite.
fn cholesky(matrix: &mut [f64], size: usize) -> bool {
    for row in 0..size {
        for column in 0..=row {
            let known: f64 = (0..column).map(|k| matrix[row * size + k] * matrix[column * size + k]).sum();
            let rest = matrix[row * size + column] - known;
            if row == column {
                // Below this the pivot is rounding of what was subtracted.
                if rest.is_nan() || rest <= 1e-12 * matrix[row * size + row].abs() {
                    return false;
                }
                matrix[row * size + row] = rest.sqrt();
            } else {
                matrix[row * size + column] = rest / matrix[column * size + column];
            }
        }
    }
    true
}

/// Solves `L Lᵀ x = side` in place.
fn solve(factor: &[f64], size: usize, side: &mut [f64]) {
    for row in 0..size {
        let known: f64 = (0..row).map(|k| factor[row * size + k] * side[k]).sum();
        side[row] = (side[row] - known) / factor[row * size + row];
    }
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|k| factor[k * size + row] * side[k]).sum();
        side[row] = (side[row] - known) / factor[row * size + row];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Dtype, Field, Schema};

    /// A point that each action moves by `gain`; the latent is its double.
    struct Doubled {
        gain: f64,
    }

    impl WorldModel for Doubled {
        fn latent_width(&self) -> usize {
            1
        }

        fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
            latent[0] = 2.0 * row.get::<f64>("state")?[0];
            Ok(())
        }

        fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError> {
            latent[0] += 2.0 * self.gain * action[0];
            Ok(())
        }
    }

    /// The point moves by every action; `jump` is added at row 3.
    fn episode(jump: f64) -> Batch {
        let fields = vec![Field::step("state", Dtype::F64, &[1]), Field::step("action", Dtype::F64, &[1])];
        let mut rows = Batch::new(Schema::new(fields).expect("names differ"), 6);
        let mut place = 0.0;
        for row in 0..6 {
            if row == 3 {
                place += jump;
            }
            rows.rows_mut().select(row).write(0, &[place]);
            rows.rows_mut().select(row).write(1, &[1.0]);
            place += 1.0;
        }
        rows
    }

    #[test]
    fn errors_grow_with_the_horizon_as_they_must() {
        let exact = open_loop_error(&mut Doubled { gain: 1.0 }, &[episode(0.0)], 4).unwrap().unwrap();
        assert_eq!(exact, [0.0; 4]);
        // Too short by a tenth per step: the latent is off by 0.2 after every one.
        let wrong = open_loop_error(&mut Doubled { gain: 0.9 }, &[episode(0.0)], 3).unwrap().unwrap();
        let expected = [0.04, 0.16, 0.36];
        assert!(wrong.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{wrong:?}");
        assert!(open_loop_error(&mut Doubled { gain: 1.0 }, &[episode(0.0)], 6).unwrap().is_none());
    }

    #[test]
    fn what_cannot_be_surprises() {
        let model = &mut Doubled { gain: 1.0 };
        let (possible, impossible) =
            (surprise(model, &episode(0.0)).unwrap(), surprise(model, &episode(5.0)).unwrap());
        assert_eq!(possible, [0.0; 5]);
        assert_eq!(impossible, [0.0, 0.0, 100.0, 0.0, 0.0], "only the row of the jump");
        let tie = [possible.clone(), possible.clone()];
        assert_eq!(violation_accuracy(&[[possible, impossible], tie]), Some(0.75));
        assert_eq!(violation_accuracy(&[]), None);
    }

    #[test]
    fn probes_find_a_linear_map_and_ridge_shrinks_it() {
        let latents: Vec<Vec<f64>> =
            (0..40).map(f64::from).map(|t| vec![t.sin(), (2.3 * t).cos(), t / 40.0]).collect();
        let states: Vec<Vec<f64>> =
            latents.iter().map(|z| vec![3.0 * z[0] - z[1] + 7.0, 0.5 * z[2]]).collect();
        let probe = LinearProbe::fit(&latents[..30], &states[..30], 0.0).unwrap();
        for score in probe.score(&latents[30..], &states[30..]) {
            assert!(score.mse < 1e-20 && score.correlation.unwrap() > 0.999_999, "{score:?}");
        }
        let shrunk = LinearProbe::fit(&latents, &states, 1.0).unwrap();
        assert!(shrunk.weights[0][0] < 2.0 && shrunk.weights[0][0] > 0.0, "{:?}", shrunk.weights);
        // One predictor: the slope is Σxy / (Σx² + λN).
        let single = LinearProbe::fit(&[vec![-1.0], vec![1.0]], &[vec![-2.0], vec![2.0]], 0.5).unwrap();
        assert!((single.weights[0][0] - 4.0 / 3.0).abs() < 1e-12);
        let twice: Vec<Vec<f64>> = latents.iter().map(|z| vec![z[0], z[0]]).collect();
        assert_eq!(LinearProbe::fit(&twice, &states, 0.0), None, "a singular covariance");
        assert!(LinearProbe::fit(&[], &[], 0.0).is_none());
    }
}
