//! Continual learning: how what is learned in one phase of a stream of tasks helps or hurts in the others.

use serde::{Deserialize, Serialize};

/// What a matrix of results says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Transfer {
    /// Mean result over all phases after the last one.
    pub average: f64,
    /// How much a phase's result changed from right after it to the end, on average: negative is forgetting. `None` for
    /// fewer than two phases.
    pub backward: Option<f64>,
    /// How much better a phase's result was right before it than that of an untrained policy, on average. `None` for
    /// fewer than two phases or without untrained results.
    pub forward: Option<f64>,
    /// Per phase, how far its result fell from its best to the end (0 or more); the last phase has none.
    pub forgetting: Vec<f64>,
}

impl Transfer {
    /// From `results[i][j]`, the result in phase j after training on phases 0 to i, `[T, T]`, and `untrained[j]`, `[T]`,
    /// the result in phase j before any training. Rows of another length give `None`.
    ///
    /// Source: D. Lopez-Paz and M. Ranzato, "Gradient episodic memory for continual learning", NeurIPS 2017, equations 2
    /// to 4; forgetting is that of A. Chaudhry et al., "Riemannian walk for incremental learning", ECCV 2018.
    pub fn of(results: &[Vec<f64>], untrained: Option<&[f64]>) -> Option<Self> {
        let count = results.len();
        let fits = results.iter().all(|row| row.len() == count);
        if count == 0 || !fits || untrained.is_some_and(|row| row.len() != count) {
            return None;
        }
        let last = &results[count - 1];
        let mean = |sum: f64| (count > 1).then(|| sum / (count - 1) as f64);
        Some(Self {
            average: last.iter().sum::<f64>() / count as f64,
            backward: mean((0..count - 1).map(|i| last[i] - results[i][i]).sum()),
            forward: untrained
                .and_then(|untrained| mean((1..count).map(|i| results[i - 1][i] - untrained[i]).sum())),
            forgetting: (0..count - 1)
                .map(|j| {
                    let best =
                        results[..count - 1].iter().map(|row| row[j]).fold(f64::NEG_INFINITY, f64::max);
                    (best - last[j]).max(0.0)
                })
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfer_is_that_of_the_paper() {
        let results = vec![vec![80.0, 30.0, 10.0], vec![60.0, 90.0, 20.0], vec![50.0, 70.0, 95.0]];
        let transfer = Transfer::of(&results, Some(&[5.0, 10.0, 5.0])).unwrap();
        assert!((transfer.average - 215.0 / 3.0).abs() < 1e-12);
        assert_eq!(transfer.backward, Some(-25.0));
        assert_eq!(transfer.forward, Some(17.5));
        assert_eq!(transfer.forgetting, [30.0, 20.0]);
        assert_eq!(Transfer::of(&results, None).unwrap().forward, None);
        assert_eq!(Transfer::of(&[vec![1.0]], None).unwrap().backward, None);
        assert_eq!(Transfer::of(&[vec![1.0, 2.0]], None), None);
    }
}
