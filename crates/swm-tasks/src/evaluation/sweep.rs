//! Robustness: the same pairs under changed factors of variation, one factor alone, each group, all together, beside the
//! unchanged environment. Which changes there are is the duty of `changes`, running them that of `run`.

mod changes;
mod folder;
mod run;
mod trial;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::evaluate::{PairedTest, Summary};

use super::receipt::Code;
use super::run::Candidate;
pub(crate) use changes::unknown_factor;
pub use changes::{Change, Scope, Values, changes, grid_points};
pub use folder::{existing_sweep, read_sweep, write_sweep};
pub use run::SweepRun;

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
    /// SHA-256 of every file that the policy depends on: its models.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
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

impl Cell {
    /// A cell that nothing is known of yet.
    fn new(name: &str, scope: Scope, value: &str) -> Self {
        Self {
            name: name.to_owned(),
            scope,
            value: value.to_owned(),
            summary: None,
            test: None,
            pairs: Vec::new(),
            note: None,
            successes: Vec::new(),
        }
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
