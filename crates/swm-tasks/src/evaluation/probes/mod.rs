//! Probes: what a model's latents hold of the true state, told by small maps that are fitted to rows with both. A linear one
//! says what lies open, a network of one hidden layer what is there at all. Models are `swm_core::evaluate::quality`.

mod network;
#[cfg(feature = "faer")]
mod ridge;
mod target;

use serde::Serialize;
use swm_core::Batch;
use swm_core::evaluate::stats::correlation;
use swm_core::moments::{Moments, of_rows};

use crate::error::TaskError;

pub use network::NetworkProbe;
#[cfg(feature = "faer")]
pub use ridge::LinearProbe;
pub use target::ProbeTarget;

/// Rows with latents and what they should tell: `inputs` is `[N, Z]`, `outputs` `[N, S]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Z.
    pub input_width: usize,
    /// S.
    pub output_width: usize,
    /// `[N, Z]`.
    pub inputs: Vec<f64>,
    /// `[N, S]`.
    pub outputs: Vec<f64>,
}

impl Samples {
    /// N.
    pub fn len(&self) -> usize {
        self.outputs.len() / self.output_width.max(1)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// How well a column of the true state is told, on episodes that the probes were not fitted to.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Probed {
    /// What is told, as [`ProbeTarget`] writes it.
    pub column: String,
    /// By a linear map; none where this program was built without `faer`.
    pub linear: Option<ProbeScore>,
    /// By a network of one hidden layer.
    pub network: ProbeScore,
}

impl Probed {
    /// The mean share of the variance that the better probe explains, R²; none where nothing varies.
    pub fn r2(&self) -> Option<f64> {
        let scores = [self.linear.as_ref(), Some(&self.network)];
        scores
            .into_iter()
            .flatten()
            .filter_map(|score| score.unexplained)
            .reduce(f64::min)
            .map(|rest| 1.0 - rest)
    }
}

/// How well a probe tells one column.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct ProbeScore {
    /// Mean squared error of each number of the column, in its unit squared.
    pub mse: Vec<f64>,
    /// Pearson's correlation of what is told and what is true, per number; none where one is constant.
    pub correlation: Vec<Option<f64>>,
    /// Share of the variance that is explained, R², per number; none where it is constant.
    pub r2: Vec<Option<f64>>,
    /// Mean over the numbers that vary of MSE by variance: 1 is as good as their mean, 0 is perfect.
    pub unexplained: Option<f64>,
}

impl ProbeScore {
    /// Mean of the correlations that there are.
    pub fn mean_correlation(&self) -> Option<f64> {
        mean(self.correlation.iter().flatten().copied())
    }

    /// Scores `told` against `truth`, both `[N, S]`.
    pub fn of(told: &[f64], truth: &[f64], width: usize) -> Self {
        let column = |values: &[f64], index: usize| -> Vec<f64> {
            values.chunks_exact(width.max(1)).map(|row| row[index]).collect()
        };
        let (mut score, mut unexplained) = (
            Self { mse: Vec::new(), correlation: Vec::new(), r2: Vec::new(), unexplained: None },
            Vec::new(),
        );
        for index in 0..width {
            let (told, truth) = (column(told, index), column(truth, index));
            let spread: Moments = truth.iter().copied().collect();
            let error = told.iter().zip(&truth).map(|(a, b)| (a - b) * (a - b));
            let mse = mean(error).unwrap_or(0.0);
            score.mse.push(mse);
            score.correlation.push(correlation(&told, &truth));
            let share = (!spread.is_constant()).then(|| mse / spread.variance());
            score.r2.push(share.map(|share| 1.0 - share));
            unexplained.extend(share);
        }
        score.unexplained = mean(unexplained.into_iter());
        score
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Fits probes for each of `targets` to four fifths of the episodes, and scores them on every fifth. `known` are the latents of
/// each episode, `[T, Z]`. `seed`: of the network's weights and of the order of its samples.
///
/// # Errors
///
/// Fewer than two episodes, or a column that does not exist or holds no numbers on one side.
pub fn probe(
    episodes: &[Batch],
    known: &[Vec<f64>],
    latent_dim: usize,
    targets: &[ProbeTarget],
    seed: u64,
) -> Result<Vec<Probed>, TaskError> {
    if episodes.len() < 2 {
        return Err(
            "probes are scored on other episodes than they are fitted to: 2 episodes or more are needed"
                .into(),
        );
    }
    let probed = |target: &ProbeTarget| {
        let mut parts = [Samples::default(), Samples::default()];
        for (index, (rows, latents)) in episodes.iter().zip(known).enumerate() {
            // With few episodes the last one is the fifth.
            let is_scored = index % 5 == 4 || (episodes.len() < 5 && index + 1 == episodes.len());
            let part = &mut parts[usize::from(is_scored)];
            let (values, width) = target.values(rows)?;
            (part.input_width, part.output_width) = (latent_dim, width);
            for (row, numbers) in values.chunks_exact(width.max(1)).enumerate() {
                let latent = &latents[row * part.input_width..][..part.input_width];
                // What is missing somewhere (no action behind the last row) cannot be told there.
                if numbers.iter().chain(latent).all(|number| number.is_finite()) {
                    part.inputs.extend(latent);
                    part.outputs.extend(numbers);
                }
            }
        }
        let [fitted, scored] = &parts;
        if fitted.is_empty() || scored.is_empty() {
            return Err(format!("`{target}`: no rows with numbers on both sides of the split").into());
        }
        let score = |told: Vec<f64>| ProbeScore::of(&told, &scored.outputs, scored.output_width);
        #[cfg(feature = "faer")]
        let linear = LinearProbe::fit(fitted, RIDGE).map(|probe| score(probe.tell(&scored.inputs)));
        #[cfg(not(feature = "faer"))]
        let linear = None;
        let network = NetworkProbe::fit(fitted, seed);
        Ok(Probed { column: target.to_string(), linear, network: score(network.tell(&scored.inputs)) })
    };
    targets.iter().map(probed).collect()
}

/// Penalty of the linear probe, in units of the inputs' variance.
#[cfg(feature = "faer")]
const RIDGE: f64 = 1e-4;

/// Shifts and scales columns to mean 0 and std 1; what is constant becomes 0.
#[derive(Clone, Debug, PartialEq)]
struct Scaling {
    means: Vec<f64>,
    stds: Vec<f64>,
}

impl Scaling {
    fn of(values: &[f64], width: usize) -> Self {
        let columns = of_rows(values, width);
        let std = |column: &Moments| if column.is_constant() { 0.0 } else { column.std() };
        Self { means: columns.iter().map(Moments::mean).collect(), stds: columns.iter().map(std).collect() }
    }

    fn apply(&self, values: &[f64]) -> Vec<f64> {
        let scale = |row: &[f64]| -> Vec<f64> {
            let numbers = row.iter().zip(&self.means).zip(&self.stds);
            numbers.map(|((x, mean), std)| if *std > 0.0 { (x - mean) / std } else { 0.0 }).collect()
        };
        values.chunks_exact(self.means.len().max(1)).flat_map(scale).collect()
    }

    fn undo(&self, values: &mut [f64]) {
        for row in values.chunks_exact_mut(self.means.len().max(1)) {
            for ((x, mean), std) in row.iter_mut().zip(&self.means).zip(&self.stds) {
                *x = *x * std + mean;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `outputs = f(inputs)` on a lattice that no period of it divides.
    pub(super) fn samples(count: usize, offset: f64, tell: impl Fn([f64; 3]) -> [f64; 2]) -> Samples {
        let mut samples = Samples { input_width: 3, output_width: 2, ..Samples::default() };
        for t in (0..count).map(|t| t as f64 + offset) {
            let input = [(0.7 * t).sin(), (1.3 * t + 1.0).sin(), (2.9 * t + 2.0).sin()];
            samples.inputs.extend(input);
            samples.outputs.extend(tell(input));
        }
        samples
    }

    #[test]
    fn scores_are_what_they_say() {
        let truth = [0.0, 5.0, 1.0, 5.0, 2.0, 5.0];
        let perfect = ProbeScore::of(&truth, &truth, 2);
        assert_eq!(
            (perfect.mse, perfect.correlation[1], perfect.unexplained),
            (vec![0.0, 0.0], None, Some(0.0))
        );
        let mean = ProbeScore::of(&[1.0, 6.0, 1.0, 6.0, 1.0, 6.0], &truth, 2);
        assert_eq!(mean.unexplained, Some(1.0));
        assert!((mean.mse[0] - 2.0 / 3.0).abs() < 1e-15 && mean.mse[1] == 1.0);
        assert_eq!(
            mean.r2,
            [Some(0.0), None],
            "the mean explains nothing, and of a constant there is nothing to"
        );
        assert_eq!(mean.mean_correlation(), None);
    }

    #[test]
    fn scaling_is_undone_and_forgives_constants() {
        let values = [1.0, 7.0, 3.0, 7.0, 8.0, 7.0];
        let scaling = Scaling::of(&values, 2);
        let mut scaled = scaling.apply(&values);
        assert!((scaled[0] + scaled[2] + scaled[4]).abs() < 1e-12);
        assert_eq!([scaled[1], scaled[3], scaled[5]], [0.0; 3]);
        scaling.undo(&mut scaled);
        assert!(scaled.iter().zip(values).all(|(a, b)| (a - b).abs() < 1e-12), "{scaled:?}");
    }
}
