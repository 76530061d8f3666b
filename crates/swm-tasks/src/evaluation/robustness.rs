//! Several sweeps of one manifest as one table: models of several seeds under every change, with the oracle and published figures.

use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};
use swm_core::evaluate::{Summary, wilson95};

use super::sweep::{Cell, Sweep};
use crate::error::{TaskError, cannot, wrong};
use crate::report_page::sweep_figure;
use crate::text_file::replace_text;

/// The version of [`Robustness`] that is written.
pub const ROBUSTNESS_VERSION: u32 = 1;

/// Success in percent that a paper gives for its own data, by change; `unchanged` among them.
#[derive(Clone, Copy, Debug)]
pub struct Published {
    /// What it is of, and where it is from.
    pub source: &'static str,
    /// Names of changes, and percent.
    pub rows: &'static [(&'static str, f64)],
}

/// A task with a table of its own.
#[derive(Clone, Copy, Debug)]
pub struct RobustTask {
    /// Its name: `pusht`.
    pub name: &'static str,
    /// The environment.
    pub env: &'static str,
    /// What is published for it.
    pub published: Published,
}

/// The tasks.
pub const ROBUST_TASKS: &[RobustTask] = &[RobustTask {
    name: "pusht",
    env: "swm/PushT-v1",
    published: Published {
        source: "DINO-WM (arXiv 2602.08968, Table 2; goals of people's episodes)",
        rows: &[
            ("unchanged", 94.0),
            ("background.color", 10.0),
            ("agent.color", 18.0),
            ("block.color", 18.0),
            ("goal.color", 20.0),
            ("agent.scale", 4.0),
            ("block.scale", 16.0),
            ("goal.scale", 14.0),
            ("agent.angle", 12.0),
            ("goal.angle", 12.0),
            ("goal.position", 4.0),
            ("agent.shape", 18.0),
            ("block.shape", 8.0),
            ("agent.velocity", 14.0),
        ],
    },
}];

/// The table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Robustness {
    /// [`ROBUSTNESS_VERSION`].
    pub robustness: u32,
    /// Environment id.
    pub env: String,
    /// Hash of the manifest.
    pub manifest_hash: String,
    /// Its tier.
    pub tier: String,
    /// Pairs of the manifest.
    pub pairs: usize,
    /// The policies, each with the SHA-256 of its files in its sweep.
    pub policies: Vec<String>,
    /// The oracle, if it was evaluated.
    pub oracle: Option<String>,
    /// What the published figures are of.
    pub published: Option<String>,
    /// The unchanged environment first.
    pub rows: Vec<RobustnessRow>,
}

/// A change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RobustnessRow {
    /// What is changed.
    pub name: String,
    /// The values in a word.
    pub value: String,
    /// Success of each policy in percent; none where the values cannot be.
    pub success: Vec<Option<f64>>,
    /// Mean of these.
    pub mean: Option<f64>,
    /// 95 % Wilson interval of all episodes of all policies together, in percent.
    pub ci95: Option<[f64; 2]>,
    /// The oracle's success in percent.
    pub oracle: Option<f64>,
    /// What is published.
    pub published: Option<f64>,
}

impl Robustness {
    /// Joins sweeps of policies, and the oracle's.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: no sweep, or sweeps of different manifests or changes.
    pub fn join(
        sweeps: &[Sweep],
        oracle: Option<&Sweep>,
        published: Option<Published>,
    ) -> Result<Self, TaskError> {
        let Some(first) = sweeps.first() else { return Err(wrong("there is no sweep to join")) };
        for other in sweeps.iter().chain(oracle) {
            if other.manifest_hash != first.manifest_hash {
                return Err(wrong(format!("`{}` was evaluated on another manifest", other.candidate.policy)));
            }
            let names = |sweep: &Sweep| -> Vec<(String, String)> {
                sweep.cells.iter().map(|cell| (cell.name.clone(), cell.value.clone())).collect()
            };
            if names(other) != names(first) {
                return Err(wrong(format!("`{}` was evaluated under other changes", other.candidate.policy)));
            }
        }
        let rate = |cell: &Cell| cell.summary.as_ref().map(|summary| summary.success_rate);
        let row = |(at, cell): (usize, &Cell)| {
            let success: Vec<Option<f64>> = sweeps.iter().map(|sweep| rate(&sweep.cells[at])).collect();
            let known: Vec<f64> = success.iter().copied().flatten().collect();
            let published = published.and_then(|of| of.rows.iter().find(|(name, _)| *name == cell.name));
            RobustnessRow {
                name: cell.name.clone(),
                value: cell.value.clone(),
                mean: (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64),
                success,
                ci95: pooled(sweeps, at).map(|summary| summary.ci95),
                oracle: oracle.and_then(|oracle| rate(&oracle.cells[at])),
                published: published.map(|(_, percent)| *percent),
            }
        };
        Ok(Self {
            robustness: ROBUSTNESS_VERSION,
            env: first.env.clone(),
            manifest_hash: first.manifest_hash.clone(),
            tier: first.tier.clone(),
            pairs: first.cells[0].successes.len(),
            policies: sweeps.iter().map(|sweep| sweep.policy.clone()).collect(),
            oracle: oracle.map(|oracle| oracle.policy.clone()),
            published: published.map(|of| of.source.to_owned()),
            rows: first.cells.iter().enumerate().map(row).collect(),
        })
    }

    /// The table in Markdown.
    pub fn markdown(&self) -> String {
        let percent = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.0} %"));
        let mut text = format!(
            "{}, {} tier, {} pairs, {} training{}\n\n",
            self.env,
            self.tier,
            self.pairs,
            self.policies.len(),
            if self.policies.len() == 1 { "" } else { "s" }
        );
        let with = |given: bool, head: &'static str| if given { head } else { "" };
        let (oracle, published) =
            (with(self.oracle.is_some(), " oracle |"), with(self.published.is_some(), " published |"));
        let ruled = |given: &str| if given.is_empty() { "" } else { "---|" };
        let _ = writeln!(text, "| changed | each | mean (95 % of all) |{oracle}{published}");
        let _ = writeln!(text, "|---|---|---|{}{}", ruled(oracle), ruled(published));
        for row in &self.rows {
            let each: Vec<String> = row.success.iter().map(|success| percent(*success)).collect();
            let interval = row.ci95.map_or(String::new(), |[low, high]| format!(" ({low:.1} to {high:.1})"));
            let name = if row.name == "unchanged" { "nothing".to_owned() } else { format!("`{}`", row.name) };
            let _ = write!(text, "| {name} | {} | {}{interval} |", each.join(", "), percent(row.mean));
            for (is_given, value) in
                [(self.oracle.is_some(), row.oracle), (self.published.is_some(), row.published)]
            {
                if is_given {
                    let _ = write!(text, " {} |", percent(value));
                }
            }
            text.push('\n');
        }
        if let Some(source) = &self.published {
            let _ = writeln!(text, "\nPublished: {source}.");
        }
        text
    }

    /// Writes `robustness.json`, `robustness.md` and `robustness.svg` into `dir`. Existing files are replaced.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn write(&self, dir: &Path, sweeps: &[Sweep]) -> Result<(), TaskError> {
        let write = |name: &str, text: &str| {
            let path = dir.join(name);
            replace_text(&path, text).map_err(cannot("write", &path))
        };
        write("robustness.json", &(serde_json::to_string_pretty(self)? + "\n"))?;
        write("robustness.md", &self.markdown())?;
        if let Some(first) = sweeps.first() {
            let cell = |(at, cell): (usize, &Cell)| Cell { summary: pooled(sweeps, at), ..cell.clone() };
            let cells = first.cells.iter().enumerate().map(cell).collect();
            write("robustness.svg", &sweep_figure(&Sweep { cells, ..first.clone() }))?;
        }
        Ok(())
    }
}

/// All episodes of a cell, of all sweeps together.
fn pooled(sweeps: &[Sweep], at: usize) -> Option<Summary> {
    let all = || sweeps.iter().filter_map(|sweep| sweep.cells[at].summary.as_ref());
    let mut summary = all().next()?.clone();
    summary.episodes = all().map(|summary| summary.episodes).sum();
    summary.successes = all().map(|summary| summary.successes).sum();
    summary.solved_at_start = all().map(|summary| summary.solved_at_start).sum();
    summary.success_rate = 100.0 * summary.successes as f64 / summary.episodes.max(1) as f64;
    summary.ci95 = wilson95(summary.successes, summary.episodes);
    Some(summary)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};

    use super::*;

    /// Two cells with these successes of ten; nothing where the values cannot be.
    fn sweep(manifest: &str, successes: [Option<usize>; 2]) -> Sweep {
        let cell = |(name, successes): (&str, Option<usize>)| {
            let summary = successes.map(|successes| {
                let rate = 10.0 * successes as f64;
                json!({"episodes": 10, "successes": successes, "success_rate": rate, "ci95": wilson95(successes, 10),
                    "solved_at_start": 0, "mean_success_steps": Json::Null})
            });
            let scope = if name == "unchanged" { "unchanged" } else { "factor" };
            json!({"name": name, "scope": scope, "value": "sampled", "summary": summary, "test": Json::Null,
                "successes": vec![true; 10]})
        };
        let cells: Vec<Json> = ["unchanged", "agent.color"].into_iter().zip(successes).map(cell).collect();
        let policy = json!({"name": "gcsl", "positional": ["run"], "named": {}});
        serde_json::from_value(
            json!({"sweep": 1, "env": "swm/PushT-v1", "manifest_hash": manifest, "tier": "historic",
            "candidate": {"policy": policy}, "policy": "gcsl:run", "values": "sampled",
            "code": {"version": "0", "target": "x"}, "cells": cells}),
        )
        .unwrap()
    }

    #[test]
    fn sweeps_of_several_trainings_are_one_table() {
        let sweeps = [sweep("a", [Some(8), Some(2)]), sweep("a", [Some(6), None])];
        let oracle = sweep("a", [Some(10), Some(9)]);
        let published = ROBUST_TASKS[0].published;
        let table = Robustness::join(&sweeps, Some(&oracle), Some(published)).unwrap();
        let [unchanged, color] = &table.rows[..] else { panic!("two rows") };
        assert_eq!((unchanged.mean, unchanged.ci95), (Some(70.0), Some(wilson95(14, 20))));
        assert_eq!((color.mean, color.ci95), (Some(20.0), Some(wilson95(2, 10))));
        assert_eq!((&color.success[..], color.oracle), (&[Some(20.0), None][..], Some(90.0)));
        assert_eq!((unchanged.published, color.published), (Some(94.0), Some(18.0)));
        let text = table.markdown();
        assert!(
            text.contains(
                "| changed | each | mean (95 % of all) | oracle | published |\n|---|---|---|---|---|\n"
            ),
            "{text}"
        );
        assert!(text.contains("| `agent.color` | 20 %, – | 20 % (5.7 to 51.0) | 90 % | 18 % |"), "{text}");
        let alone = Robustness::join(&sweeps[..1], None, None).unwrap().markdown();
        assert!(
            alone.contains("|---|---|---|\n| nothing | 80 % | 80 % (") && !alone.contains("Published"),
            "{alone}"
        );
        let folder = tempfile::tempdir().unwrap();
        table.write(folder.path(), &sweeps).unwrap();
        let read = std::fs::read_to_string(folder.path().join("robustness.json")).unwrap();
        assert_eq!(serde_json::from_str::<Robustness>(&read).unwrap(), table);
        assert!(std::fs::read_to_string(folder.path().join("robustness.svg")).unwrap().contains("<svg"));
    }

    #[test]
    fn sweeps_that_do_not_belong_together_are_refused() {
        let refused = |sweeps: &[Sweep]| Robustness::join(sweeps, None, None).unwrap_err().to_string();
        let one = || sweep("a", [Some(8), Some(2)]);
        assert!(refused(&[one(), sweep("b", [Some(8), Some(2)])]).contains("another manifest"));
        let mut other = one();
        other.cells.pop();
        assert!(refused(&[one(), other]).contains("under other changes"));
        assert!(refused(&[]).contains("no sweep"));
    }

    #[test]
    fn published_rows_are_factors_of_the_table() {
        for task in ROBUST_TASKS {
            assert_eq!(task.published.rows[0].0, "unchanged", "{}", task.name);
            let percent = |(_, percent): &(&str, f64)| (0.0..=100.0).contains(percent);
            assert!(task.published.rows.iter().all(percent));
        }
    }
}
