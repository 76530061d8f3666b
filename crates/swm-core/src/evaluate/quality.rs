//! How good a world model is without control: open-loop prediction by horizon, surprise at what cannot be. Over a small trait,
//! which learned, analytic and simulated models implement alike. Probes, which are fitted, are not here but in the facade.

use crate::batch::{Batch, Row};
use crate::error::BoxError;

/// A model of the world in a latent space, as far as its quality can be measured from recorded rows.
pub trait WorldModel: Send {
    /// Z: numbers of a latent.
    fn latent_dim(&self) -> usize;

    /// F: rows from a latent to the one that is predicted of it, and actions in between.
    fn stride(&self) -> usize {
        1
    }

    /// Writes the latent `[Z]` of a row.
    ///
    /// # Errors
    ///
    /// The row lacks a column that the model reads, or the model fails.
    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError>;

    /// Replaces the latent `[Z]` by what follows it under the actions `[F, A]`.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError>;

    /// Writes the latents `[N, Z]` of all rows `[N]` of a table. A network, which is faster on many rows at once, has its own.
    ///
    /// # Errors
    ///
    /// As of [`WorldModel::encode`].
    fn encode_rows(&mut self, rows: &Batch, latents: &mut [f64]) -> Result<(), BoxError> {
        let dim = self.latent_dim();
        let mut latents = latents.chunks_exact_mut(dim.max(1));
        (0..rows.rows()).zip(&mut latents).try_for_each(|(row, latent)| self.encode(rows.row(row), latent))
    }

    /// Replaces latents `[N, Z]` by what follows them under the actions `[N, F, A]`. As [`WorldModel::encode_rows`].
    ///
    /// # Errors
    ///
    /// As of [`WorldModel::predict`].
    fn predict_rows(&mut self, latents: &mut [f64], actions: &[f64]) -> Result<(), BoxError> {
        let dim = self.latent_dim().max(1);
        let count = latents.len() / dim;
        let actions = actions.chunks_exact((actions.len() / count.max(1)).max(1));
        latents
            .chunks_exact_mut(dim)
            .zip(actions)
            .try_for_each(|(latent, action)| self.predict(latent, action))
    }
}

/// The latents of all rows of a table, `[N, Z]`.
///
/// # Errors
///
/// As of [`WorldModel::encode`].
pub fn latents(model: &mut dyn WorldModel, rows: &Batch) -> Result<Vec<f64>, BoxError> {
    let mut latents = vec![0.0; rows.rows() * model.latent_dim()];
    model.encode_rows(rows, &mut latents)?;
    Ok(latents)
}

/// Mean squared error per number of the latent after 1, 2, … predictions of F rows each, as many as `horizon` rows hold,
/// `[horizon / F]`: open loop from every row of the recorded episodes (each a table with the column `action`) from which so
/// many follow. `None` where none do.
///
/// # Errors
///
/// An episode has no column `action`, or the model fails.
pub fn open_loop_error(
    model: &mut dyn WorldModel,
    episodes: &[Batch],
    horizon: usize,
) -> Result<Option<Vec<f64>>, BoxError> {
    let (dim, stride) = (model.latent_dim(), model.stride());
    let (mut sums, mut count) = (vec![0.0; horizon / stride], 0_usize);
    let horizon = sums.len() * stride;
    for rows in episodes {
        let action = rows.schema().require("action")?;
        let starts = rows.rows().saturating_sub(horizon);
        if starts == 0 {
            continue;
        }
        let known = latents(model, rows)?;
        let actions = numbers(rows, action);
        let wide = actions.len() / rows.rows();
        let mut predicted = known[..starts * dim].to_vec();
        for (step, sum) in sums.iter_mut().enumerate() {
            let taken = spans(&actions[step * stride * wide..], wide, stride, starts);
            model.predict_rows(&mut predicted, &taken)?;
            *sum += squared(&predicted, &known[(step + 1) * stride * dim..][..starts * dim]) / dim as f64;
        }
        count += starts;
    }
    Ok((count > 0 && horizon > 0).then(|| sums.into_iter().map(|sum| sum / count as f64).collect()))
}

/// How surprised a model is by each row of an episode after the first F, `[T - F]`: squared error of its prediction from the
/// row F before, per number. Rows that cannot follow (something vanished, or is elsewhere) should stand out.
///
/// # Errors
///
/// The episode has no column `action`, or the model fails.
pub fn surprise(model: &mut dyn WorldModel, rows: &Batch) -> Result<Vec<f64>, BoxError> {
    let (dim, action) = (model.latent_dim(), rows.schema().require("action")?);
    let stride = model.stride();
    let Some(count) = rows.rows().checked_sub(stride) else { return Ok(Vec::new()) };
    let known = latents(model, rows)?;
    let actions = numbers(rows, action);
    let mut predicted = known[..count * dim].to_vec();
    let wide = actions.len() / rows.rows().max(1);
    model.predict_rows(&mut predicted, &spans(&actions, wide, stride, count))?;
    let latent = dim.max(1);
    let followed = predicted.chunks_exact(latent).zip(known[stride * dim..].chunks_exact(latent));
    Ok(followed.map(|(told, true_one)| squared(told, true_one) / dim as f64).collect())
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

/// The actions `[N, F, A]` of N rows on end, F each from its own row on, of `actions` `[…, A]`.
fn spans(actions: &[f64], wide: usize, stride: usize, count: usize) -> Vec<f64> {
    (0..count).flat_map(|row| &actions[row * wide..][..stride * wide]).copied().collect()
}

/// All numbers of a column, `[N, …]`; NaN for what is none.
fn numbers(rows: &Batch, column: usize) -> Vec<f64> {
    let values = rows.column(column);
    (0..values.len()).map(|index| values.as_f64(index).unwrap_or(f64::NAN)).collect()
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Dtype, Field, Schema};

    /// A point that each action moves by `gain`; the latent is its double. It predicts `stride` rows at a time.
    struct Doubled {
        gain: f64,
        stride: usize,
    }

    fn doubled(gain: f64) -> Doubled {
        Doubled { gain, stride: 1 }
    }

    impl WorldModel for Doubled {
        fn latent_dim(&self) -> usize {
            1
        }

        fn stride(&self) -> usize {
            self.stride
        }

        fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
            latent[0] = 2.0 * row.get::<f64>("state")?[0];
            Ok(())
        }

        fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError> {
            assert_eq!(action.len(), self.stride);
            latent[0] += 2.0 * self.gain * action.iter().sum::<f64>();
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
        let exact = open_loop_error(&mut doubled(1.0), &[episode(0.0)], 4).unwrap().unwrap();
        assert_eq!(exact, [0.0; 4]);
        // Too short by a tenth per step: the latent is off by 0.2 after every one.
        let wrong = open_loop_error(&mut doubled(0.9), &[episode(0.0)], 3).unwrap().unwrap();
        let expected = [0.04, 0.16, 0.36];
        assert!(wrong.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{wrong:?}");
        assert!(open_loop_error(&mut doubled(1.0), &[episode(0.0)], 6).unwrap().is_none());
    }

    #[test]
    fn some_models_predict_many_rows_at_a_time() {
        let mut model = Doubled { gain: 0.9, stride: 2 };
        let wrong = open_loop_error(&mut model, &[episode(0.0)], 5).unwrap().unwrap();
        let expected = [0.16, 0.64];
        assert!(wrong.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{wrong:?}");
        assert!(
            open_loop_error(&mut model, &[episode(0.0)], 1).unwrap().is_none(),
            "shorter than a prediction"
        );
        model.gain = 1.0;
        assert_eq!(surprise(&mut model, &episode(5.0)).unwrap(), [0.0, 100.0, 100.0, 0.0]);
    }

    #[test]
    fn what_cannot_be_surprises() {
        let model = &mut doubled(1.0);
        let (possible, impossible) =
            (surprise(model, &episode(0.0)).unwrap(), surprise(model, &episode(5.0)).unwrap());
        assert_eq!(possible, [0.0; 5]);
        assert_eq!(impossible, [0.0, 0.0, 100.0, 0.0, 0.0], "only the row of the jump");
        let tie = [possible.clone(), possible.clone()];
        assert_eq!(violation_accuracy(&[[possible, impossible], tie]), Some(0.75));
        assert_eq!(violation_accuracy(&[]), None);
    }
}
