//! `swm replay`: do a dataset and the simulator still agree?

use std::path::PathBuf;
use std::sync::LazyLock;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, Request as _};

use super::args::{assignments, json_value};
use super::opening::DataArgs;
use super::output::{compact, counted, table};
use super::reporter::Reporter;
use super::scenario::set;
use super::threads::ThreadsArg;
use super::words::Renamed;
use super::{Failure, Output};
use crate::replay::ReplayReport;

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Replay> = LazyLock::new(request::Replay::default);

/// What has options of other names.
const WORDS: Renamed = Renamed(&[("dataset", "the dataset"), ("env", "--env")]);

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
    #[arg(long, default_value_t = DEFAULT.tolerance)]
    tolerance: f64,
    #[command(flatten)]
    opening: DataArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Replay {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Replay {
            dataset: self.file,
            env: self.env,
            env_option: assignments(&self.env_options, "--env-option", json_value)?,
            episodes: self.episodes,
            set: set(&self.set, output)?,
            tolerance: self.tolerance,
            opening: self.opening.options()?,
            threads: self.threads.count(),
        };
        let mut reporter = Reporter::new(output, Cancel::new());
        let report = request.run(registry, &mut reporter).map_err(|error| WORDS.failure(error))?;
        output.result(&report, || text(&report))?;
        if report.ok {
            return Ok(());
        }
        let worst = report.columns.iter().max_by(|a, b| a.1.max_abs.total_cmp(&b.1.max_abs));
        let worst = worst.map(|(name, d)| format!("`{name}` by {}", compact(d.max_abs))).unwrap_or_default();
        Err(format!("dataset and simulator differ by more than {:e}: {worst}", report.tolerance).into())
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
