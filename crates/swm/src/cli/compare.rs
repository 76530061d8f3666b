//! `swm compare`: is one policy better than another, on the same pairs?

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value as Json;
use swm_core::evaluate::Transfer;

use super::output::table;
use super::rates::{at_reset, difference, percent};
use super::{Failure, Output, usage};
use crate::evaluation::{Compared, Receipt, Side, compare, read_receipt};

/// Compare results on the same manifest, pair by pair.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm compare results/cem results/mppi
  swm compare results/cem-seed1,results/cem-seed2,results/cem-seed3 results/mppi-seed1,results/mppi-seed2
  swm compare --stream after-phase-0 after-phase-1 after-phase-2 --untrained random

Runs of one policy with several seeds, joined by commas, are one side: the difference is that of the means of all runs, its interval \
a bootstrap over pairs and runs, its p-value that of an exact sign-flip test over pairs (for one run each: McNemar's). \
`± seeds` is the standard deviation of the success rates of its runs, in percentage points. Below the table: in what each evaluation \
differs from the first one (settings, weights, seed, physics). \
--stream takes results of one policy on one stream, after training on each of its phases, and reports forward and backward transfer.")]
pub(super) struct Compare {
    /// Receipts, or the folders that hold them; several seeds of one policy joined by commas.
    #[arg(required = true, value_name = "RESULT")]
    results: Vec<String>,
    /// The results are those of one policy after each phase of a stream: report forward and backward transfer.
    #[arg(long)]
    stream: bool,
    /// With --stream: the result before any training.
    #[arg(long, requires = "stream", value_name = "RESULT")]
    untrained: Option<PathBuf>,
}

impl Compare {
    pub(super) fn run(self, output: &Output) -> Result<(), Failure> {
        let sides = self.results.iter().map(|text| read_side(text)).collect::<Result<Vec<_>, _>>()?;
        let compared = compare(&sides).map_err(usage)?;
        if self.stream {
            return self.transfer(&sides, output);
        }
        let rows = compared.iter().zip(&sides).map(|(side, results)| {
            // As `--policy` takes it; `side.policy` names models by their hash.
            let policy = format!("{}{}", results.runs()[0].candidate.policy, seeds(results));
            let test = side.test.as_ref();
            let [difference, p] = test
                .map(|test| difference(test.difference, test.interval95, test.p_value))
                .unwrap_or_default();
            let std = side.std.map_or(String::new(), |std| format!("{std:.1}"));
            let rate = percent(side.success_rate, side.ci95);
            vec![side.name.clone(), policy, side.runs.to_string(), rate, std, difference, p]
        });
        if sides.len() == 1 {
            output.note("note: this is one result; name a second one to compare it with");
        }
        let head = ["result", "policy", "runs", "success (95 %)", "± seeds", "first − this", "paired test"];
        output.result(&compared, || {
            let first = &sides[0].runs()[0];
            let pairs = first.episodes.len();
            format!(
                "{}, {} tier, {pairs} pairs{}\n\n{}{}",
                first.manifest.env,
                first.manifest.tier.name(),
                at_reset(first.summary.solved_at_start),
                table(&head, rows),
                differing(&compared)
            )
        })
    }

    fn transfer(&self, sides: &[Side], output: &Output) -> Result<(), Failure> {
        let row = |receipt: &Receipt| -> Vec<f64> {
            receipt.phases.iter().map(|phase| phase.success_rate).collect()
        };
        let results: Vec<Vec<f64>> = sides.iter().map(|side| row(&side.runs()[0])).collect();
        let untrained = self.untrained.as_deref().map(read_receipt).transpose().map_err(usage)?;
        if let Some(untrained) = &untrained
            && untrained.manifest_hash != sides[0].runs()[0].manifest_hash
        {
            return Err(usage("the untrained result is of another manifest"));
        }
        let untrained = untrained.as_ref().map(row);
        let transfer = Transfer::of(&results, untrained.as_deref()).ok_or_else(|| {
            let (found, phases) = (results.len(), results.first().map_or(0, Vec::len));
            usage(format!(
                "{found} result(s) on a stream of {phases} phase(s): one result after each phase is needed (manifests with \
                 phases are made with `swm manifest make --stream`)"
            ))
        })?;
        let json = serde_json::json!({ "results": results, "untrained": untrained, "transfer": transfer });
        output.result(&json, || {
            let head: Vec<String> =
                std::iter::once("after".to_owned()).chain((0..results.len()).map(|j| format!("phase {j}"))).collect();
            let numbers = |row: &[f64]| row.iter().map(|rate| format!("{rate:.1}")).collect::<Vec<_>>();
            let line = |name: String, row: &[f64]| [vec![name], numbers(row)].concat();
            let mut rows: Vec<Vec<String>> =
                untrained.iter().map(|row| line("no training".to_owned(), row)).collect();
            rows.extend(results.iter().enumerate().map(|(i, row)| line(format!("phase {i}"), row)));
            let head: Vec<&str> = head.iter().map(String::as_str).collect();
            let points = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:+.1}"));
            format!(
                "{}\naverage at the end {:.1} %, backward transfer {}, forward transfer {} (percentage points)\n",
                table(&head, rows),
                transfer.average,
                points(transfer.backward),
                points(transfer.forward)
            )
        })
    }
}

/// In what the evaluations differ from the first one: a line per result.
fn differing(compared: &[Compared]) -> String {
    let line = |side: &Compared| {
        let all: Vec<String> = side
            .differs
            .iter()
            .map(|one| format!("{} {} (first: {})", one.what, shown(&one.this), shown(&one.first)))
            .collect();
        format!("{} differs in: {}\n", side.name, all.join(", "))
    };
    let lines: String = compared.iter().filter(|side| !side.differs.is_empty()).map(line).collect();
    if lines.is_empty() { lines } else { format!("\n{lines}") }
}

/// A value in few words: hashes by their beginning.
fn shown(value: &Json) -> String {
    match value {
        Json::Null => "–".to_owned(),
        Json::String(text) if text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit()) => {
            text[..12].to_owned()
        }
        Json::String(text) => text.clone(),
        Json::Array(all) if all.is_empty() => "none".to_owned(),
        Json::Array(all) => all.iter().map(shown).collect::<Vec<_>>().join(" + "),
        other => other.to_string(),
    }
}

/// The seeds of the runs of a side, where one was chosen.
fn seeds(side: &Side) -> String {
    let seeds: Vec<u64> = side.runs().iter().map(|run| run.candidate.seed).collect();
    let all: Vec<String> = seeds.iter().map(u64::to_string).collect();
    match seeds.iter().any(|&seed| seed != 0) {
        true => format!(" (policy seed {})", all.join(", ")),
        false => String::new(),
    }
}

fn read_side(text: &str) -> Result<Side, Failure> {
    let runs = text.split(',').map(|path| read_receipt(Path::new(path.trim()))).collect::<Result<_, _>>();
    runs.and_then(|runs| Side::new(text, runs)).map_err(usage)
}
