//! `swm stats`: statistics of columns, for people and for normalization.

use std::path::PathBuf;

use clap::Args;
use swm_core::checkpoint::CHECKPOINT;
use swm_core::{Cancel, Registry};
use swm_data::recording::EP_IDX;
use swm_data::stats::{ColumnStatistics, Statistics};
use swm_tasks::request::{self, Request as _};

use super::opening::OpenArgs;
use super::output::{counted, table};
use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output};

/// Columns of numbers that count or name something, or are bytes: their mean says nothing. The later ones are of other programs.
const NO_QUANTITIES: [&str; 9] = [
    EP_IDX,
    "step_idx",
    "seed",
    CHECKPOINT,
    "episode_idx",
    "episode_index",
    "frame_index",
    "index",
    "task_index",
];

/// Show mean, std, extremes and quantiles of columns; store them next to the dataset.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm stats pusht.h5
  swm stats pusht.h5 --columns action,proprio --json
  swm stats pusht.h5 --quantiles 0.01,0.99

Found in one pass and kept in `<dataset>.stats.json`, where the loader's normalization looks for them. Of images there is \
one set of numbers per channel, of other columns one per value. Indices, seeds and stored states are left out of the table, where their mean \
says nothing; the JSON and the file have every column. Rows with a NaN, such as the last action of an episode, do \
not count.")]
pub(super) struct Stats {
    /// The dataset.
    file: PathBuf,
    /// Only these columns.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    columns: Option<Vec<String>>,
    /// Quantiles, each from 0 to 1.
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    quantiles: Option<Vec<f64>>,
    /// Do not store them next to the dataset.
    #[arg(long)]
    no_store: bool,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Stats {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Stats {
            dataset: self.file,
            columns: self.columns,
            quantiles: self.quantiles,
            store: !self.no_store,
            opening: self.opening.options()?,
            threads: self.threads.count(),
        };
        let found = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&found, || {
            text(&found, request.columns.is_some(), request.quantiles.as_deref().unwrap_or_default())
        })
    }
}

/// The table of all columns that were named, else of those of quantities.
fn text(found: &Statistics, is_named: bool, quantiles: &[f64]) -> String {
    let is_listed = |name: &str| is_named || !NO_QUANTITIES.contains(&name);
    let listed = found.columns.iter().filter(|(name, _)| is_listed(name));
    let rows = listed.flat_map(|(name, column)| lines(name, column, quantiles));
    let levels: Vec<String> = quantiles.iter().map(|q| format!("{} %", 100.0 * q)).collect();
    let mut header = vec!["column", "rows", "not finite", "mean", "std", "min", "max"];
    header.extend(levels.iter().map(String::as_str));
    let left: Vec<&str> = found.columns.keys().map(String::as_str).filter(|name| !is_listed(name)).collect();
    let left = match left.as_slice() {
        [] => String::new(),
        left => {
            format!("\nnot listed, as they hold no quantities: {} (--columns lists them)\n", left.join(", "))
        }
    };
    let (episodes, steps) = (counted(found.episodes, "episode"), counted(found.rows, "row"));
    format!("{episodes}, {steps}\n\n{}{left}", table(&header, rows))
}

/// One line per value of a column, the first few of them, with these quantiles.
fn lines(name: &str, column: &ColumnStatistics, quantiles: &[f64]) -> Vec<Vec<String>> {
    const MOST: usize = 8;
    let cell =
        |values: &[f64], at: usize| values.get(at).map_or("-".to_owned(), |value| format!("{value:.4}"));
    let count = column.mean.len().max(1);
    let mut rows: Vec<Vec<String>> = (0..count.min(MOST))
        .map(|at| {
            let mut row = vec![
                if count == 1 { name.to_owned() } else { format!("{name}[{at}]") },
                column.rows.to_string(),
                column.not_finite.to_string(),
                cell(&column.mean, at),
                cell(&column.std, at),
                cell(&column.min, at),
                cell(&column.max, at),
            ];
            let values = quantiles.iter().map(|q| column.quantiles.iter().find(|(known, _)| known == q));
            row.extend(values.map(|found| found.map_or("-".to_owned(), |(_, values)| cell(values, at))));
            row
        })
        .collect();
    if count > MOST {
        let mut rest = vec![format!("{name}[{MOST}…{}]", count - 1)];
        rest.resize(7 + quantiles.len(), "…".to_owned());
        rows.push(rest);
    }
    rows
}
