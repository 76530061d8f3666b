//! Robustness: the same pairs under changed factors of variation, one factor alone, each group, all together, beside the
//! unchanged environment. Which changes there are is the duty of `changes`.

mod changes;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::env::FactorSpec;
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{Env, EnvConfig, EnvEntry, EnvError, Episode, EpisodeSeed, Manifest, Registry, ResetOptions};

use super::receipt::Code;
use super::run::{Candidate, RunOptions, run_pairs};
pub use changes::{Change, Scope, Values, changes};

/// The version of [`Sweep`] that is written and read.
pub const SWEEP_VERSION: u32 = 1;

/// A policy under changed factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Sweep {
    /// [`SWEEP_VERSION`].
    pub sweep: u32,
    /// Environment id.
    pub env: String,
    /// Hash of the manifest that is changed.
    pub manifest_hash: String,
    /// Its tier.
    pub tier: String,
    /// The policy.
    pub candidate: Candidate,
    /// The policy in its own words.
    pub policy: String,
    /// Which values factors get.
    pub values: Values,
    /// What made it.
    pub code: Code,
    /// The unchanged environment first, then factors in the order of their table, groups, all.
    pub cells: Vec<Cell>,
}

/// One evaluation of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Cell {
    /// What is changed: a factor's or group's name, `all`, or `unchanged`.
    pub name: String,
    /// Which of these it is.
    pub scope: Scope,
    /// The values in a word: `sampled`, `lowest`, `highest`, or a share of the range.
    pub value: String,
    /// What it came to; nothing if the values cannot be.
    pub summary: Option<Summary>,
    /// This cell against the unchanged environment, pair by pair.
    pub test: Option<PairedTest>,
    /// Why it could not run, or that nothing came of the change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Success, pair by pair.
    pub successes: Vec<bool>,
}

/// Evaluates the unchanged environment and every change. `each` is called after every cell with its number and their count.
///
/// # Errors
///
/// A factor is unknown or a grid too small; the unchanged environment cannot be evaluated. A change that cannot be is
/// a cell with a note.
pub fn sweep(
    registry: &Registry,
    manifest: &Manifest,
    candidate: &Candidate,
    asked: &[String],
    values: Values,
    options: RunOptions,
    mut each: impl FnMut(usize, usize, &Cell),
) -> Result<Sweep, BoxError> {
    let entry = registry.env(&manifest.env)?;
    let mut trial = Trial::new(entry, manifest)?;
    let changes = changes(&trial.factors, asked, values)?;
    let count = changes.len() + 1;
    let policy = candidate.make(registry, entry, manifest)?.describe();
    let (none, steps) = (BTreeMap::new(), candidate.plan_steps(registry, entry, manifest));
    let run = |resets: &[ResetOptions], checked: bool| {
        run_pairs(registry, manifest, resets, candidate, steps, options, &none, checked, |_, _| Ok(()))
    };
    let base_resets = manifest.resets()?;
    let base = run(&base_resets, true)?;
    let successes = |episodes: &[EpisodeResult]| episodes.iter().map(|e| e.success).collect::<Vec<bool>>();
    let unchanged = successes(&base);
    let mut cells = vec![Cell {
        name: "unchanged".to_owned(),
        scope: Scope::Unchanged,
        value: String::new(),
        summary: Some(Summary::of(&base)),
        test: None,
        note: None,
        successes: unchanged.clone(),
    }];
    each(0, count, &cells[0]);
    for change in changes {
        let mut cell = Cell {
            name: change.name.clone(),
            scope: change.scope,
            value: change.value.clone(),
            summary: None,
            test: None,
            note: None,
            successes: Vec::new(),
        };
        let resets: Vec<ResetOptions> =
            base_resets.iter().map(|reset| change.apply(&trial.factors, reset)).collect();
        match trial.refusal(manifest, &resets)? {
            Some(reason) => cell.note = Some(reason),
            None => {
                let episodes = run(&resets, false)?;
                let same = |(a, b): (&EpisodeResult, &EpisodeResult)| {
                    (a.success, a.steps, &a.decisions, a.final_cost)
                        == (b.success, b.steps, &b.decisions, b.final_cost)
                };
                if base.iter().zip(&episodes).all(same) {
                    cell.note = Some("every episode goes as without the change".to_owned());
                }
                cell.successes = successes(&episodes);
                cell.summary = Some(Summary::of(&episodes));
                cell.test = Some(PairedTest::of(&cell.successes, &unchanged));
            }
        }
        cells.push(cell);
        each(cells.len() - 1, count, &cells[cells.len() - 1]);
    }
    Ok(Sweep {
        sweep: SWEEP_VERSION,
        env: manifest.env.clone(),
        manifest_hash: manifest.hash(),
        tier: manifest.tier.name().to_owned(),
        candidate: candidate.clone(),
        policy,
        values,
        code: Code::this(),
        cells,
    })
}

/// An environment that changes are tried in before they are evaluated.
struct Trial {
    env: Box<dyn Env>,
    factors: Vec<FactorSpec>,
}

impl Trial {
    fn new(entry: &EnvEntry, manifest: &Manifest) -> Result<Self, BoxError> {
        let env = entry.make(&EnvConfig { image: None, settings: manifest.settings.clone() })?;
        Ok(Self { factors: env.spec().factors.clone(), env })
    }

    /// Why the environment does not take a change, if it does not.
    fn refusal(&mut self, manifest: &Manifest, resets: &[ResetOptions]) -> Result<Option<String>, BoxError> {
        for (pair, options) in manifest.pairs.iter().zip(resets) {
            let seed = EpisodeSeed::new(pair.seed as u64);
            match self.env.reset(&Episode { seed, options }) {
                Ok(_) => {}
                Err(error @ (EnvError::Constraint { .. } | EnvError::Reset { .. })) => {
                    return Ok(Some(format!("cannot be: {error}")));
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(None)
    }
}

impl Sweep {
    /// One line per cell, for spreadsheets.
    pub fn csv(&self) -> String {
        let mut csv = "scope,name,value,episodes,successes,success_rate,low,high,difference,difference_low,difference_high,p_value,note\n".to_owned();
        for cell in &self.cells {
            let scope = serde_json::to_value(cell.scope).unwrap_or_default();
            let scope = scope.as_str().unwrap_or_default().to_owned();
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let (summary, test) = (cell.summary.as_ref(), cell.test.as_ref());
            let _ = writeln!(
                csv,
                "{scope},{},{},{},{},{},{},{},{},{},{},{},{}",
                cell.name,
                cell.value,
                summary.map_or(0, |summary| summary.episodes),
                summary.map_or(0, |summary| summary.successes),
                number(summary.map(|summary| summary.success_rate)),
                number(summary.map(|summary| summary.ci95[0])),
                number(summary.map(|summary| summary.ci95[1])),
                number(test.map(|test| test.difference)),
                number(test.map(|test| test.interval95[0])),
                number(test.map(|test| test.interval95[1])),
                number(test.map(|test| test.p_value)),
                quoted(cell.note.as_deref().unwrap_or_default()),
            );
        }
        csv
    }
}

/// A text as a cell of CSV (RFC 4180).
fn quoted(text: &str) -> String {
    if text.is_empty() {
        String::new()
    } else {
        format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "))
    }
}

/// Whether JSON is a sweep rather than a receipt.
pub fn is_sweep(json: &Json) -> bool {
    json.get("sweep").and_then(Json::as_u64).is_some()
}
