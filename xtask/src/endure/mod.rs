//! `cargo xtask endure`: kills, damage, hostile files and bounds, each many times more often than in a usual run. Takes an hour or more.
//!
//! | file | duty |
//! |---|---|
//! | `trial` | one run of the command `swm` with a limit of time and memory, and how it ended |
//! | `kills` | recordings, jobs, evaluations, sweeps and trainings that are killed and go on |
//! | `samples` | files of every kind that the command reads, and what is run on them |
//! | `damage` | these files with changed bytes |
//! | `table` | the table of results |
//!
//! The stages `kills` and `damage` start the command as a user does. The stage `tests` is that of the tests which the variable
//! `SWM_ENDURE` prolongs; they try the readers within one process, and so more often.

mod damage;
mod kills;
mod samples;
mod table;
mod trial;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};

use crate::{process, setup, test};
use table::Table;
use trial::Swm;

/// Options of `cargo xtask endure`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only kinds and tests whose name contains this
    #[arg(value_name = "NAME")]
    filter: Option<String>,
    /// Only these stages; may be repeated. Default: all
    #[arg(long, value_enum, value_name = "STAGE")]
    only: Vec<Stage>,
    /// Kills, over all kinds of work
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    kills: usize,
    /// Damaged files, over all kinds of files
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    damaged: usize,
    /// Runs at once. Default: one per core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// The command `swm` to run. Default: one that is built with all features, in the profile `dev`
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Also write the table of results here, as Markdown
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// A part of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Stage {
    Kills,
    Damage,
    Tests,
}

/// The tests that the variable `SWM_ENDURE` prolongs, and those that always do all they can.
const TESTS: &[&str] =
    &["crash::", "mutations::", "hostile", "exhaustion::", "power_loss::", "damage", "factor_bounds::"];
/// Features of the program: all that read files.
const FEATURES: &str = "cli,faer,mp4,rapier,lerobot,baselines";

/// Runs the stages.
pub(crate) fn run(args: &Args) -> Result<()> {
    let has = |stage| args.only.is_empty() || args.only.contains(&stage);
    let mut table = Table::default();
    if has(Stage::Kills) || has(Stage::Damage) {
        let swm = Swm::new(program(args.program.as_deref())?)?;
        let threads = args.threads.or_else(|| std::thread::available_parallelism().ok().map(usize::from));
        let threads = threads.unwrap_or(1).max(1);
        let filter = args.filter.as_deref().unwrap_or_default();
        if has(Stage::Kills) {
            kills::run(&swm, args.kills, threads, filter, &mut table)?;
        }
        if has(Stage::Damage) {
            damage::run(&swm, args.damaged, threads, filter, &mut table)?;
        }
        print!("{table}");
        if let Some(out) = &args.out {
            std::fs::write(out, table.to_string())
                .with_context(|| format!("cannot write {}", out.display()))?;
        }
    }
    // The table is worth more than the first failure: it comes before.
    let failures = table.failures();
    if has(Stage::Tests) {
        tests(args.filter.as_deref())?;
    }
    match failures {
        0 => Ok(()),
        failures => bail!("{failures} of the runs ended as they must not; the lines above name them"),
    }
}

/// The program under test.
fn program(given: Option<&Path>) -> Result<PathBuf> {
    if let Some(given) = given {
        return given.canonicalize().with_context(|| format!("no program at {}", given.display()));
    }
    setup::for_build()?;
    let build =
        ["build", "--package", "swm", "--bin", "swm", "--no-default-features", "--features", FEATURES];
    process::run(&mut process::cargo(build))?;
    let target = crate::metadata::Metadata::load()?.target_directory;
    Ok(target.join("debug").join(format!("swm{}", std::env::consts::EXE_SUFFIX)))
}

/// Sets up, then runs them one after the other, so that the memory and the time of each are its own.
fn tests(filter: Option<&str>) -> Result<()> {
    setup::run(&setup::Args::default())?;
    let mut command = process::cargo(["test", "--no-fail-fast", "--test", "it", "--test", "integration"]);
    command.args(test::whole_workspace()).arg("--");
    match filter {
        Some(name) => command.arg(name),
        None => command.args(TESTS),
    };
    process::run(command.args(["--test-threads=1", "--nocapture"]).env("SWM_ENDURE", "1"))
}
