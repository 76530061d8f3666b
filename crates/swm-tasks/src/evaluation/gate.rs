//! The gate: what a world model should reach before plans are made on it. A model that misses it is not worth the time of
//! an evaluation.

use serde::Serialize;

use super::probes::Probed;
use super::quality::Ranking;

/// The least share of a probed quantity's variance that a probe should explain.
pub const PROBE_R2: f64 = 0.8;
/// The least rank correlation of model cost and true cost.
pub const RANK_CORRELATION: f64 = 0.85;

/// One requirement.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct GateCheck {
    /// What is asked for.
    pub name: String,
    /// What was found; none where it could not be measured.
    pub found: Option<f64>,
    /// The least that passes.
    pub least: f64,
    /// Whether it passes.
    pub passes: bool,
}

impl GateCheck {
    fn new(name: String, found: Option<f64>, least: f64) -> Self {
        Self { name, found, least, passes: found.is_some_and(|found| found >= least) }
    }
}

/// The requirements on probes, by the better of both, and on the ranking of plans where there is one.
pub(super) fn checks(probes: &[Probed], ranking: Option<&Ranking>) -> Vec<GateCheck> {
    let probes = probes
        .iter()
        .map(|probed| GateCheck::new(format!("probe R² of {}", probed.column), probed.r2(), PROBE_R2));
    let name = "rank correlation of model cost and true cost".to_owned();
    let ranking = ranking.map(|ranking| GateCheck::new(name, ranking.mean, RANK_CORRELATION));
    probes.chain(ranking).collect()
}

#[cfg(test)]
mod tests {
    use super::super::probes::ProbeScore;
    use super::*;

    #[test]
    fn the_better_probe_counts_and_a_constant_cost_fails() {
        let score = |unexplained| ProbeScore {
            mse: Vec::new(),
            correlation: Vec::new(),
            r2: Vec::new(),
            unexplained,
        };
        let probed = |linear, network| Probed {
            column: "state".to_owned(),
            linear: Some(score(linear)),
            network: score(network),
        };
        let probes = [probed(Some(0.25), Some(0.125)), probed(Some(0.5), Some(0.75)), probed(None, None)];
        let ranking = |mean| Ranking { mean, by_start: Vec::new() };
        let found = checks(&probes, Some(&ranking(Some(0.9))));
        let passes: Vec<_> = found.iter().map(|check| (check.found, check.passes)).collect();
        assert_eq!(passes, [(Some(0.875), true), (Some(0.5), false), (None, false), (Some(0.9), true)]);
        assert!(!checks(&[], Some(&ranking(None)))[0].passes);
        assert!(checks(&[], None).is_empty());
    }
}
