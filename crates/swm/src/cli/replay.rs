//! `swm replay`: do a dataset and the simulator still agree?

use std::path::PathBuf;

use clap::Args;
use swm_core::{EnvConfig, Registry};
use swm_tasks::request::open_dataset_with;

use super::args::{assignments, json_value};
use super::opening::DataArgs;
use super::output::{compact, counted, table};
use super::scenario::factor_values;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};
use crate::replay::{ReplayReport, recorded_env, replay};

/// Re-run recorded actions from recorded starts and compare every state column.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm replay pusht.h5
  swm replay pusht.h5 --episodes 0..10 --tolerance 1e-9 --json
  swm replay from_the_reference.h5 --env swm/PushT-v1 --tolerance 0.5

Exit status 1 if a column differs by more than the tolerance.")]
pub(super) struct Replay {
    /// The dataset.
    file: PathBuf,
    /// The environment; required for files that do not name it.
    #[arg(long)]
    env: Option<String>,
    /// A setting of that environment. May be repeated.
    #[arg(long = "env-option", value_name = "NAME=VALUE", requires = "env")]
    env_options: Vec<String>,
    /// Episodes to replay: `5`, `0..10` or `0,3,7`. Default: all.
    #[arg(long)]
    episodes: Option<String>,
    /// A factor to set in place of the recorded one, `NAME=VALUE`; may be repeated. For files whose simulator interpreted
    /// it differently.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Largest accepted absolute error of any value.
    #[arg(long, default_value_t = 1e-6)]
    tolerance: f64,
    #[command(flatten)]
    opening: DataArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Replay {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let mut dataset = open_dataset_with(registry, &self.file, &self.opening.options()?)?;
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(usage(format!("--tolerance {}: use a number of 0 or more", self.tolerance)));
        }
        let episodes = selection(self.episodes.as_deref(), dataset.num_episodes())?;
        let entry = match &self.env {
            Some(id) => registry.env(id)?,
            None => recorded_env(registry, &dataset, &self.file).map_err(usage)?,
        };
        let mut settings = dataset.metadata().map(|metadata| metadata.settings.clone()).unwrap_or_default();
        settings.extend(assignments(&self.env_options, "--env-option", json_value)?);
        let factors = entry.make(&EnvConfig { image: None, settings })?.spec().factors.clone();
        let overrides = factor_values(&self.set, entry, &factors, output)?;
        let bar = output.bar(episodes.len() as u64, "episodes");
        let report = replay(entry, &mut dataset, &episodes, &overrides, self.tolerance, |_| bar.inc(1))?;
        bar.finish_and_clear();
        output.result(&report, || text(&report))?;
        if report.ok {
            return Ok(());
        }
        let worst = report.columns.iter().max_by(|a, b| a.1.max_abs.total_cmp(&b.1.max_abs));
        let worst = worst.map(|(name, d)| format!("`{name}` by {}", compact(d.max_abs))).unwrap_or_default();
        Err(format!("dataset and simulator differ by more than {:e}: {worst}", self.tolerance).into())
    }
}

fn text(report: &ReplayReport) -> String {
    let rows =
        report.columns.iter().map(|(name, d)| vec![name.clone(), compact(d.max_abs), compact(d.final_abs)]);
    let checkpoints = match (report.checkpoints, report.checkpoints_differ) {
        (0, _) => String::new(),
        (all, 0) => format!(", all {all} checkpoints equal"),
        (all, differ) => format!(", {differ} of {all} checkpoints differ in some bit"),
    };
    let verdict = if report.ok { "agree" } else { "differ" };
    format!(
        "{}\n{}, {}: dataset and simulator {verdict} (tolerance {:e}){checkpoints}",
        table(&["column", "largest difference", "at the end"], rows),
        counted(report.episodes, "episode"),
        counted(report.rows, "row"),
        report.tolerance,
    )
}

/// `None`, `5`, `0..10` or `0,3,7` as episode numbers below `count`.
pub(super) fn selection(text: Option<&str>, count: usize) -> Result<Vec<usize>, Failure> {
    if count == 0 {
        return Err("the dataset holds no episode".into());
    }
    let Some(text) = text else { return Ok((0..count).collect()) };
    let wrong = |why: &str| usage(format!("--episodes {text}: {why}"));
    let number = |part: &str| part.trim().parse::<usize>().map_err(|_| wrong("write 5, 0..10 or 0,3,7"));
    let chosen: Vec<usize> = match text.split_once("..") {
        Some((first, end)) => {
            let first = if first.is_empty() { 0 } else { number(first)? };
            let end = if end.is_empty() { count } else { number(end)? };
            if end > count {
                let missing = first.max(count);
                return Err(wrong(&format!("there is no episode {missing}; the dataset holds {count}")));
            }
            (first..end).collect()
        }
        None => text.split(',').map(number).collect::<Result<_, _>>()?,
    };
    match chosen.iter().find(|&&episode| episode >= count) {
        Some(episode) => Err(wrong(&format!("there is no episode {episode}; the dataset holds {count}"))),
        None if chosen.is_empty() => Err(wrong("no episode is chosen")),
        None => Ok(chosen),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_are_chosen_by_number_range_or_list() {
        assert_eq!(selection(None, 3).unwrap(), [0, 1, 2]);
        assert_eq!(selection(Some("1"), 3).unwrap(), [1]);
        assert_eq!(selection(Some("1.."), 3).unwrap(), [1, 2]);
        assert_eq!(selection(Some("0, 2"), 3).unwrap(), [0, 2]);
        for wrong in ["3", "a", "2..2", "0..4", "0..18446744073709551615", "2..0", "18446744073709551615.."] {
            assert!(selection(Some(wrong), 3).is_err(), "{wrong}");
        }
    }
}
