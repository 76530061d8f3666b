//! Robustness: the same pairs under changed factors of variation, one factor alone, each group, all together, beside the
//! unchanged environment. Which changes there are is the duty of `changes`.

mod changes;
mod trial;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{Manifest, Registry, ResetOptions};

use super::receipt::Code;
use super::run::{Candidate, RunOptions, run_pairs};
pub use changes::{Change, Scope, Values, changes};
use trial::Trial;

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
    /// The pairs that were evaluated, where not all of them can have the values; empty: all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<usize>,
    /// Why it could not run in all pairs, or that nothing came of the change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Success, pair by pair, of those that were evaluated.
    pub successes: Vec<bool>,
}

/// Evaluates the unchanged environment and every change. `each` is called after every cell with its number and their count.
///
/// # Errors
///
/// A factor is unknown or a grid too small; the unchanged environment cannot be evaluated. A change that
/// cannot be is a cell with a note; one that can be in some pairs, or nearly, is evaluated so.
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
    let run = |resets: &[ResetOptions], known: &BTreeMap<u64, EpisodeResult>, checked: bool| {
        run_pairs(registry, manifest, resets, candidate, steps, options, known, checked, |_, _| Ok(()))
    };
    let base_resets = manifest.resets()?;
    let base = run(&base_resets, &none, true)?;
    let successes = |episodes: &[EpisodeResult]| episodes.iter().map(|e| e.success).collect::<Vec<bool>>();
    let mut cells = vec![Cell {
        name: "unchanged".to_owned(),
        scope: Scope::Unchanged,
        value: String::new(),
        summary: Some(Summary::of(&base)),
        test: None,
        pairs: Vec::new(),
        note: None,
        successes: successes(&base),
    }];
    each(0, count, &cells[0]);
    for change in changes {
        let mut cell = Cell {
            name: change.name.clone(),
            scope: change.scope,
            value: change.value.clone(),
            summary: None,
            test: None,
            pairs: Vec::new(),
            note: None,
            successes: Vec::new(),
        };
        let tried = trial.admit(manifest, &base_resets, &change)?;
        let pairs = tried.pairs();
        let mut notes: Vec<String> = tried.note(base.len()).into_iter().collect();
        if !pairs.is_empty() {
            // Pairs that cannot have the values are not run.
            let left_out = (0..base.len()).filter(|pair| !pairs.contains(pair));
            let known = left_out.map(|pair| (pair as u64, base[pair].clone())).collect();
            let all = run(&tried.resets(&base_resets), &known, false)?;
            let of_pairs = |episodes: &[EpisodeResult]| -> Vec<EpisodeResult> {
                pairs.iter().map(|&pair| episodes[pair].clone()).collect()
            };
            let (before, episodes) = (of_pairs(&base), of_pairs(&all));
            let same = |(a, b): (&EpisodeResult, &EpisodeResult)| {
                (a.success, a.steps, &a.decisions, a.final_cost)
                    == (b.success, b.steps, &b.decisions, b.final_cost)
            };
            if before.iter().zip(&episodes).all(same) {
                notes.push("every episode goes as without the change".to_owned());
            }
            cell.successes = successes(&episodes);
            cell.summary = Some(Summary::of(&episodes));
            cell.test = Some(PairedTest::of(&cell.successes, &successes(&before)));
            if pairs.len() < base.len() {
                cell.pairs = pairs;
            }
        }
        cell.note = (!notes.is_empty()).then(|| notes.join("; "));
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
