//! Results of policies on one manifest, compared pair by pair.

use std::collections::BTreeSet;

use serde::Serialize;
use swm_core::PolicyArgs;
use swm_core::evaluate::PairedRuns;
use swm_core::evaluate::stats::{bootstrap95, mean_and_std};

use super::difference::{Difference, differences};
use super::receipt::Receipt;
use super::verify::edited;
use crate::error::TaskError;

/// One side of a comparison: runs of one policy with different seeds on one manifest.
#[derive(Clone, Debug)]
pub struct Side {
    /// What errors and tables call it.
    name: String,
    runs: Vec<Receipt>,
}

/// One side in figures.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Compared {
    /// Name of the side.
    pub name: String,
    /// The policy with its settings.
    pub policy: String,
    /// How many runs of it.
    pub runs: usize,
    /// Mean over the runs, in percent.
    pub success_rate: f64,
    /// In percent: Wilson for one run, bootstrap over pairs for several.
    pub ci95: [f64; 2],
    /// Sample standard deviation of the runs' success rates, in percentage points; `None` for one run.
    pub std: Option<f64>,
    /// The first side against this one, all runs of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub test: Option<PairedRuns>,
    /// In what this evaluation differs from the first one: settings, weights, seed, physics.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub differs: Vec<Difference>,
}

impl Side {
    /// # Errors
    ///
    /// No runs, runs of different policies or manifests, two runs with one seed, or a receipt whose figures are not those of its episodes.
    pub fn new(name: impl Into<String>, runs: Vec<Receipt>) -> Result<Self, TaskError> {
        let name = name.into();
        let Some(first) = runs.first() else {
            return Err(format!("{name}: a side without a result; give one or more").into());
        };
        if let Some(reason) = runs.iter().find_map(edited) {
            return Err(format!("{name}: {reason}; the receipt was edited or damaged; evaluate again").into());
        }
        if let Some(other) = runs.iter().find(|run| run.candidate.policy != first.candidate.policy) {
            let (one, other) = (&first.candidate.policy, &other.candidate.policy);
            let by_setting = |policy: &PolicyArgs| {
                let mut policy = policy.clone();
                policy.named.remove("seed");
                policy
            };
            return Err(match by_setting(one) == by_setting(other) {
                true => format!(
                    "{name}: `{one}` and `{other}` are not runs of one policy: they differ in its setting `seed`; leave that out, and \
                     evaluate the policy with the policy seeds 1, 2, …"
                ),
                false => format!(
                    "{name}: `{one}` and `{other}` are not runs of one policy, which alone are joined; compare them as results of their own"
                ),
            }
            .into());
        }
        let seeds: BTreeSet<u64> = runs.iter().map(|run| run.candidate.seed).collect();
        if seeds.len() < runs.len() {
            return Err(format!("{name}: two runs have the same policy seed, so they are one").into());
        }
        same_manifest(runs.iter().map(|run| (name.as_str(), run)))?;
        Ok(Self { name, runs })
    }

    /// The runs, at least one.
    pub fn runs(&self) -> &[Receipt] {
        &self.runs
    }

    /// This side in figures, and the `first` one against it.
    fn compared(&self, first: Option<&Self>) -> Compared {
        let successes = self.successes();
        let rates: Vec<f64> = self.runs.iter().map(|run| run.summary.success_rate).collect();
        let (success_rate, std) = mean_and_std(&rates);
        let runs = slices(&successes);
        let ci95 = match &self.runs[..] {
            [one] => one.summary.ci95,
            _ => bootstrap95(&runs, 0),
        };
        Compared {
            name: self.name.clone(),
            policy: self.runs[0].policy.clone(),
            runs: self.runs.len(),
            success_rate,
            ci95,
            std,
            test: first.and_then(|first| PairedRuns::of(&slices(&first.successes()), &runs, 0)),
            differs: first.map_or_else(Vec::new, |first| self.differences(first)),
        }
    }

    fn differences(&self, first: &Self) -> Vec<Difference> {
        let mut all = differences(&first.runs[0], &self.runs[0]);
        // Several runs differ in their seeds.
        if first.runs.len() + self.runs.len() > 2 {
            all.retain(|difference| difference.what != "policy_seed");
        }
        all
    }

    /// Successes of all runs, `[runs][pairs]`.
    fn successes(&self) -> Vec<Vec<bool>> {
        self.runs.iter().map(Receipt::successes).collect()
    }
}

/// Compares every side with the first, pair by pair.
///
/// # Errors
///
/// The sides are results of different manifests.
pub fn compare(sides: &[Side]) -> Result<Vec<Compared>, TaskError> {
    same_manifest(sides.iter().flat_map(|side| side.runs.iter().map(|run| (side.name.as_str(), run))))?;
    let compared = |(index, side): (usize, &Side)| side.compared((index > 0).then_some(&sides[0]));
    Ok(sides.iter().enumerate().map(compared).collect())
}

/// `results` are what each is called, and the result.
fn same_manifest<'a>(results: impl IntoIterator<Item = (&'a str, &'a Receipt)>) -> Result<(), TaskError> {
    let mut results = results.into_iter();
    let Some((first, one)) = results.next() else { return Ok(()) };
    let Some((other, another)) = results.find(|(_, result)| result.manifest_hash != one.manifest_hash) else {
        return Ok(());
    };
    let [one, another] = [one, another].map(|result| result.manifest_hash.get(..12).unwrap_or_default());
    Err(format!(
        "{first} (manifest {one}) and {other} (manifest {another}) are results of different manifests: they cannot be compared pair by pair; \
         `swm report` shows them beside each other"
    )
    .into())
}

fn slices(runs: &[Vec<bool>]) -> Vec<&[bool]> {
    runs.iter().map(Vec::as_slice).collect()
}
