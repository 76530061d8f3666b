//! `cargo xtask proof`: the figures of docs/proof.md and docs/robustness.md, made again. Each file `docs/proof/TASK.toml` is data: commands of `swm` that
//! record, train and evaluate. What came out is recorded in `docs/proof/TASK.json`, from which the tables of the pages are written.

mod page;
mod plan;
mod record;
mod work;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};

use self::plan::{Row, Task};
use self::record::Records;
use self::work::Work;
use crate::process;
use crate::program::Program;

/// Options of `cargo xtask proof`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Only these tasks: names of files in docs/proof, without `.toml`
    names: Vec<String>,
    /// Only these rows, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "ROWS")]
    rows: Vec<String>,
    /// Only these trainings, separated by commas: their seeds, 1 to 3
    #[arg(long, value_delimiter = ',', value_name = "SEEDS", value_parser = clap::value_parser!(u64).range(1..=plan::SEEDS))]
    seeds: Vec<u64>,
    /// One training of a few rows, compared with what is recorded of it; nothing is written to docs
    #[arg(long, conflicts_with_all = ["rows", "seeds"])]
    quick: bool,
    /// Write the tables of the pages from what is recorded, and run nothing
    #[arg(long, conflicts_with_all = ["rows", "seeds", "quick"])]
    tables: bool,
    /// Where everything goes; what is there already is not made again, and what was interrupted is continued
    #[arg(long, default_value = OUT, value_name = "DIR")]
    out: PathBuf,
    /// A command `swm` with baselines; else one is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

impl Args {
    fn chooses(&self, row: &Row, seed: u64) -> bool {
        if self.quick {
            return row.quick && seed == 1;
        }
        seed <= row.seeds
            && (self.rows.is_empty() || self.rows.contains(&row.name))
            && (self.seeds.is_empty() || self.seeds.contains(&seed))
    }
}

/// In the folder that git ignores.
const OUT: &str = "target/proof";

pub(crate) fn run(args: &Args) -> Result<()> {
    let folder = process::root().join("docs/proof");
    let tasks = plan::tasks(&folder)?;
    for name in &args.names {
        let known: Vec<&str> = tasks.iter().map(|task| task.name.as_str()).collect();
        ensure!(known.contains(&name.as_str()), "there is no task `{name}`; there are {}", known.join(", "));
    }
    for name in &args.rows {
        let is_known = tasks.iter().flat_map(Task::rows).any(|(_, row)| row.name == *name);
        ensure!(is_known, "--rows {name}: no task has this row");
    }
    let chosen = || tasks.iter().filter(|task| args.names.is_empty() || args.names.contains(&task.name));
    let has = |task: &Task| task.rows().any(|(_, row)| (1..=plan::SEEDS).any(|seed| args.chooses(row, seed)));
    ensure!(
        chosen().any(has),
        "no row of these tasks is chosen; leave out --rows, --seeds or names of tasks"
    );
    if !args.tables {
        let program = Program {
            given: args.swm.as_deref(),
            features: "cli,faer,baselines,mp4,mujoco,rapier,lerobot,onnx",
        };
        program.build()?;
        let mut faults = Vec::new();
        for task in chosen() {
            let out = std::path::absolute(&args.out)?.join(&task.name);
            faults.extend(make(task, args, &Work::open(out, &program)?, &folder)?);
        }
        if !faults.is_empty() {
            bail!("{}", faults.join("\n"));
        }
    }
    if !args.quick {
        page::write(&tasks, &folder)?;
    }
    Ok(())
}

/// One training of the rows that are quick, compared with its record: a step of `cargo xtask nightly`.
pub(crate) fn check() -> Result<()> {
    run(&Args { quick: true, out: OUT.into(), ..Args::default() })
}

/// Runs what is chosen of a task, in order of trainings, so that each row has its first before any has its second. Records are written after each; of quick ones, faults are
/// returned.
fn make(task: &Task, args: &Args, work: &Work<'_>, folder: &Path) -> Result<Vec<String>> {
    let mut records = Records::read(folder, &task.name)?;
    let mut faults = Vec::new();
    for seed in 1..=plan::SEEDS {
        for (table, row) in task.rows() {
            if !args.chooses(row, seed) {
                continue;
            }
            for step in task.steps.iter().chain(&table.steps) {
                work.step(step)?;
            }
            for step in task.needs(row) {
                work.step(&plan::with_seed(step, seed))?;
            }
            let mut training = 0.0;
            for step in &row.steps {
                training += work.step(&plan::with_seed(step, seed))?;
            }
            let made = work.result(table, row, seed, training)?;
            if args.quick {
                faults.extend(records.differences(&made));
            } else {
                records.insert(made);
                records.write(folder, &task.name)?;
            }
        }
    }
    Ok(faults.into_iter().map(|fault| format!("{}: {fault}", task.name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whoever changes a task or a record runs `cargo xtask proof --tables`.
    #[test]
    fn pages_have_what_is_recorded() {
        let folder = process::root().join("docs/proof");
        let tasks = plan::tasks(&folder).unwrap();
        for (path, found, current) in page::pages(&tasks, &folder).unwrap() {
            assert!(found == current, "{} is outdated: run `cargo xtask proof --tables`", path.display());
        }
    }
}
