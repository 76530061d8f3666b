//! What came out: the files `docs/proof/TASK.json`, an entry for each training of a row and each change of a sweep.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use sha2::{Digest as _, Sha256};

use super::plan::{Row, Table};
use crate::process;

/// One evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) table: String,
    pub(super) row: String,
    pub(super) seed: u64,
    /// Of sweeps: what was changed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) change: Option<String>,
    pub(super) successes: u64,
    pub(super) episodes: u64,
    pub(super) solved_at_start: u64,
    /// Plans that were made, of rows that count them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) plans: Option<u64>,
    /// The policy with the hash of its weights, and the hash of the manifest.
    policy: String,
    manifest: String,
    /// Of all episodes, bit by bit.
    digest: String,
    /// CPU time: of the training, and of the evaluation or the whole sweep.
    pub(super) training_minutes: f64,
    pub(super) evaluation_minutes: f64,
    pub(super) version: String,
    pub(super) machine: String,
    pub(super) date: String,
}

/// The records of a task.
#[derive(Default)]
pub(super) struct Records(pub(super) Vec<Record>);

impl Records {
    pub(super) fn read(folder: &Path, task: &str) -> Result<Self> {
        let file = folder.join(format!("{task}.json"));
        let Ok(text) = fs::read_to_string(&file) else { return Ok(Self::default()) };
        serde_json::from_str(&text).map(Self).with_context(|| format!("{} is damaged", file.display()))
    }

    /// An entry a line.
    pub(super) fn write(&self, folder: &Path, task: &str) -> Result<()> {
        let file = folder.join(format!("{task}.json"));
        let lines: Vec<String> = self.0.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        fs::write(&file, format!("[\n{}\n]\n", lines.join(",\n")))
            .with_context(|| format!("{} cannot be written", file.display()))
    }

    /// Adds records, or puts them in the place of older ones. What was only read again keeps its machine and date.
    pub(super) fn insert(&mut self, made: Vec<Record>) {
        for record in made {
            match self.0.iter_mut().find(|other| other.is_of_what(&record)) {
                Some(older) if older.has_result_of(&record) => {}
                Some(older) => *older = record,
                None => self.0.push(record),
            }
        }
        self.0.sort_by(|a, b| (&a.table, &a.row, a.seed).cmp(&(&b.table, &b.row, b.seed)));
    }

    /// Which of these lie outside of the intervals that are recorded; which do not is printed.
    pub(super) fn differences(&self, made: &[Record]) -> Vec<String> {
        let fault = |record: &Record| {
            let what = format!("{} of {}, training {}", record.row, record.table, record.seed);
            let rate = record.rate();
            let Some(known) = self.0.iter().find(|other| other.is_of_what(record)) else {
                return Some(format!(
                    "{what}: {rate:.0} %, and nothing is recorded; run `cargo xtask proof`"
                ));
            };
            let [low, high] = wilson(known.successes, known.episodes);
            let recorded = format!("recorded {:.0} % ({low:.1} to {high:.1})", known.rate());
            if !(low..=high).contains(&rate) {
                return Some(format!("{what}: {rate:.0} %; {recorded}"));
            }
            let bits = if record.digest == known.digest { "equal in every bit" } else { "other bits" };
            println!("{what}: {rate:.0} %; {recorded}; {bits}");
            None
        };
        made.iter().filter_map(fault).collect()
    }
}

impl Record {
    fn is_of_what(&self, other: &Self) -> bool {
        (&self.table, &self.row, self.seed, &self.change)
            == (&other.table, &other.row, other.seed, &other.change)
    }

    /// Whether nothing but machine and date differ.
    fn has_result_of(&self, other: &Self) -> bool {
        *self == Self { machine: self.machine.clone(), date: self.date.clone(), ..other.clone() }
    }

    /// Success in percent.
    pub(super) fn rate(&self) -> f64 {
        100.0 * self.successes as f64 / self.episodes as f64
    }
}

/// The records of a receipt, those of its reference policies included, or of a sweep.
pub(super) fn made(table: &Table, row: &Row, seed: u64, result: &Json, minutes: [f64; 2]) -> Vec<Record> {
    let text = |value: &Json| value.as_str().unwrap_or_default().to_owned();
    let code = &result["code"];
    let version = match code["commit"].as_str() {
        Some(commit) => format!("{} ({commit})", text(&code["version"])),
        None => text(&code["version"]),
    };
    let record = |name: &str, change: Option<String>, policy: &Json, summary: &Json, episodes: &Json| {
        let number = |name: &str| summary[name].as_u64();
        Some(Record {
            table: table.name.clone(),
            row: name.to_owned(),
            seed,
            change,
            successes: number("successes")?,
            episodes: number("episodes")?,
            solved_at_start: number("solved_at_start").unwrap_or(0),
            plans: row.block.filter(|_| name == row.name).map(|block| plans(episodes, block)),
            policy: text(policy),
            manifest: result["manifest_hash"].as_str()?.chars().take(16).collect(),
            digest: digest(episodes),
            training_minutes: rounded(minutes[0]),
            evaluation_minutes: rounded(minutes[1]),
            version: version.clone(),
            machine: MACHINE.clone(),
            date: TODAY.clone(),
        })
    };
    let list = |name: &str| result[name].as_array().into_iter().flatten();
    if table.is_sweep() {
        let cell = |cell: &Json| {
            record(
                &row.name,
                Some(text(&cell["name"])),
                &result["policy"],
                &cell["summary"],
                &cell["successes"],
            )
        };
        return list("cells").filter_map(cell).collect();
    }
    let own = record(&row.name, None, &result["policy"], &result["summary"], &result["episodes"]);
    let references = list("references").filter_map(|other| {
        let role = text(&other["role"]);
        let reference = record(&role, None, &other["policy"], &other["summary"], &other["episodes"])?;
        Some(Record { training_minutes: 0.0, ..reference })
    });
    own.into_iter().chain(references).collect()
}

/// Of the episodes' results: the digests that a receipt has of each, or their successes.
fn digest(episodes: &Json) -> String {
    let mut hash = Sha256::new();
    for episode in episodes.as_array().into_iter().flatten() {
        hash.update(episode["digest"].as_str().map_or_else(|| episode.to_string(), str::to_owned));
        hash.update("\n");
    }
    format!("{:x}", hash.finalize()).chars().take(16).collect()
}

/// How many plans of `block` actions the episodes took.
fn plans(episodes: &Json, block: u64) -> u64 {
    let steps = |episode: &Json| episode["steps"].as_u64().unwrap_or(0);
    episodes.as_array().into_iter().flatten().map(|episode| steps(episode).div_ceil(block)).sum()
}

fn rounded(minutes: f64) -> f64 {
    (minutes * 1000.0).round() / 1000.0
}

/// The 95 % Wilson interval of a rate, in percent.
pub(super) fn wilson(successes: u64, episodes: u64) -> [f64; 2] {
    const Z: f64 = 1.959_964;
    let (k, n) = (successes as f64, episodes as f64);
    let middle = (k + Z * Z / 2.0) / (n + Z * Z);
    let half = Z * (k * (n - k) / n + Z * Z / 4.0).sqrt() / (n + Z * Z);
    [middle - half, middle + half].map(|share| 100.0 * share.clamp(0.0, 1.0))
}

/// The CPU, and how many of its cores there are.
static MACHINE: LazyLock<String> = LazyLock::new(|| {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": ").map(|(_, name)| name));
    let plural = if cores == 1 { "" } else { "s" };
    format!("{cores} core{plural} of {}", name.unwrap_or(std::env::consts::ARCH).trim())
});

static TODAY: LazyLock<String> = LazyLock::new(|| {
    let printed = process::output(Command::new("date").args(["-u", "+%F"])).unwrap_or_default();
    String::from_utf8_lossy(&printed).trim().to_owned()
});

#[cfg(test)]
mod tests {
    use super::*;

    fn record(row: &str, seed: u64, change: Option<&str>, successes: u64) -> Record {
        Record {
            table: "t".into(),
            row: row.into(),
            seed,
            change: change.map(str::to_owned),
            successes,
            episodes: 100,
            solved_at_start: 0,
            plans: None,
            policy: String::new(),
            manifest: String::new(),
            digest: successes.to_string(),
            training_minutes: 1.0,
            evaluation_minutes: 1.0,
            version: "1.2.3".into(),
            machine: "a machine".into(),
            date: "2026-01-02".into(),
        }
    }

    #[test]
    fn newer_records_replace_those_of_the_same_and_survive_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut records = Records::read(folder.path(), "none").unwrap();
        records.insert(vec![record("b", 1, None, 5), record("a", 2, Some("x"), 6)]);
        records.insert(vec![record("b", 1, None, 7), record("a", 1, Some("x"), 8)]);
        // The same result, read by another machine, is no newer one.
        records.insert(vec![Record { machine: "another".into(), ..record("b", 1, None, 7) }]);
        assert!(records.0.iter().all(|record| record.machine == "a machine"));
        let rates: Vec<(&str, u64, u64)> =
            records.0.iter().map(|r| (r.row.as_str(), r.seed, r.successes)).collect();
        assert_eq!(rates, [("a", 1, 8), ("a", 2, 6), ("b", 1, 7)]);
        records.write(folder.path(), "task").unwrap();
        assert_eq!(Records::read(folder.path(), "task").unwrap().0, records.0);
    }

    #[test]
    fn a_rate_outside_of_the_recorded_interval_is_a_fault() {
        let records = Records(vec![record("a", 1, None, 90)]);
        assert!(records.differences(&[record("a", 1, None, 85)]).is_empty());
        let faults = records.differences(&[record("a", 1, None, 70), record("b", 1, None, 70)]);
        assert!(faults[0].contains("70 %; recorded 90 % (82.6 to 94.5)"), "{faults:?}");
        assert!(faults[1].contains("nothing is recorded"), "{faults:?}");
    }

    #[test]
    fn receipts_give_the_policy_and_its_references_and_sweeps_give_each_change() {
        let row = r#"name = "r"
                     policy = "R"
                     result = "eval --out x""#;
        let row: Row = toml::from_str(row).unwrap();
        let table = |row: Row| Table {
            name: "t".into(),
            steps: Vec::new(),
            labels: Default::default(),
            published: Default::default(),
            rows: vec![row],
        };
        let plain = table(toml::from_str("name = 'r'\npolicy = 'R'\nresult = 'eval --out x'").unwrap());
        let summary = serde_json::json!({"successes": 3, "episodes": 4, "solved_at_start": 1});
        let receipt = serde_json::json!({
            "manifest_hash": "0123456789abcdefXX", "policy": "cem", "summary": summary, "code": {"version": "1.2.3", "commit": "abc"},
            "episodes": [{"digest": "d", "steps": 6}, {"steps": 5}, {"steps": 0}], "references": [{"role": "random", "summary": summary, "episodes": []}],
        });
        let records = made(&plain, &row, 2, &receipt, [1.26, 0.5]);
        assert_eq!(records.iter().map(|r| r.row.as_str()).collect::<Vec<_>>(), ["r", "random"]);
        assert_eq!(
            (records[0].seed, records[0].training_minutes, records[1].training_minutes),
            (2, 1.26, 0.0)
        );
        assert_eq!(
            (records[0].version.as_str(), records[0].manifest.as_str()),
            ("1.2.3 (abc)", "0123456789abcdef")
        );
        assert!(records[0].digest != records[1].digest && records[0].plans.is_none());
        let planned: Row =
            toml::from_str("name = 'r'\npolicy = 'R'\nblock = 5\nresult = 'eval --out x'").unwrap();
        let records = made(&plain, &planned, 2, &receipt, [0.0; 2]);
        assert_eq!(
            (records[0].plans, records[1].plans),
            (Some(3), None),
            "two of the first episode, one of the second"
        );

        let sweeps = table(toml::from_str("name = 'r'\npolicy = 'R'\nresult = 'sweep --out x'").unwrap());
        let sweep = serde_json::json!({
            "manifest_hash": "0", "policy": "cem", "cells": [{"name": "unchanged", "summary": summary, "successes": [true]}],
        });
        assert_eq!(made(&sweeps, &row, 1, &sweep, [0.0; 2])[0].change.as_deref(), Some("unchanged"));
    }

    #[test]
    fn intervals_are_wilsons() {
        // As published in textbooks: 92 of 100.
        let [low, high] = wilson(92, 100);
        assert!((low - 85.0).abs() < 0.01 && (high - 95.89).abs() < 0.01, "{low} {high}");
        assert!((wilson(0, 10)[0]).abs() < 1e-9 && (wilson(10, 10)[1] - 100.0).abs() < 1e-9);
    }
}
