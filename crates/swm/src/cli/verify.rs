//! `swm verify` and `swm diff`: is a dataset sound, and are two the same?

use std::path::PathBuf;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_data::tools::compare::{ColumnComparison, SharedEpisodes};
use swm_tasks::request::{self, Request as _};

use super::opening::OpenArgs;
use super::output::{AlreadyReported, compact, counted, table};
use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output};

/// Read all of a dataset and report what is wrong with it.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm verify pusht.h5
  swm verify pusht.h5 --json
  swm verify pusht.video --fix --dry-run     (print what an interrupted recording needs)
  swm verify pusht.video --fix

Checked: the index of episodes; that every row of every column can be read and decoded; checksums, where the format has \
them (images in HDF5, everything in `folder` and `video`); lengths; columns that must not change in an episode; NaN and \
infinite numbers. NaN is expected in the last action of an episode, and in first and last rows.

--fix repairs a dataset whose recording was interrupted and prints each step; committed episodes are not touched. Continuing \
the recording with `--mode append` does the same. Damaged images cannot be fixed; record or copy them again.

Exit status 1 if anything is wrong or has to be repaired.")]
pub(super) struct Verify {
    /// The dataset.
    file: PathBuf,
    /// Repair what an interrupted recording left, then check.
    #[arg(long)]
    fix: bool,
    /// With --fix: only print what would be done.
    #[arg(long, requires = "fix")]
    dry_run: bool,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl Verify {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Verify {
            dataset: self.file,
            fix: self.fix,
            dry_run: self.dry_run,
            opening: self.opening.options()?,
        };
        run(&request, registry, output)
    }
}

/// Verifies all of a dataset.
pub(super) fn whole(dataset: PathBuf, registry: &Registry, output: &Output) -> Result<(), Failure> {
    run(&request::Verify { dataset, ..request::Verify::default() }, registry, output)
}

fn run(request: &request::Verify, registry: &Registry, output: &Output) -> Result<(), Failure> {
    let verified = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
    let (report, pending) = (&verified.report, &verified.to_fix);
    let finished = pending.is_empty();
    let is_unread = !report.problems.is_empty() && report.problems.iter().all(|problem| problem.unsupported);
    output.result(&verified, || {
        let mut text = format!(
            "{}: {}, {}{}\n",
            request.dataset.display(),
            counted(report.episodes, "episode"),
            counted(report.rows, "row"),
            if report.has_checksums { ", checksums compared" } else { "" },
        );
        for problem in &report.problems {
            let column = problem.column.as_ref().map(|name| format!(", column `{name}`")).unwrap_or_default();
            let episode = problem.episode.map(|episode| format!(" episode {episode}")).unwrap_or_default();
            let kind = if problem.unsupported { "NOT READ" } else { "WRONG" };
            text += &format!("{kind}{episode}{column}: {}\n", problem.reason);
        }
        for note in &report.notes {
            text += &format!("note: {note}\n");
        }
        for step in pending {
            text += &format!("interrupted recording; `swm verify --fix` will {step}\n");
        }
        text += match (report.problems.is_empty(), finished) {
            _ if is_unread => "not read as a whole: this program does not support what is named, and the dataset may be sound",
            (true, true) => "sound",
            (true, false) => "sound once it is repaired",
            (false, true) => "NOT SOUND: no repair brings back what is wrong; record or copy it again",
            (false, false) => "NOT SOUND",
        };
        text
    })?;
    let file = request.dataset.display();
    match report.problems.len() {
        0 if finished => Ok(()),
        0 => Err(format!("{file} has to be repaired; run: swm verify {file} --fix").into()),
        problems => {
            let what = if is_unread { "is not read as a whole" } else { "is not sound" };
            Err(format!("{file} {what}: {}", counted(problems, "problem")).into())
        }
    }
}

/// Compare two datasets, of any formats.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm diff a.h5 b.h5
  swm diff pusht.h5 pusht.video --columns action,state
  swm diff pusht.h5 pusht.video --ignore pixels,goal
  swm diff here.h5 there.h5 --tolerance 1e-9 --json

Shows columns that one of them lacks, episodes of different lengths, and for each column the number of rows that differ, \
by how much, and where first; for images also the PSNR in dB (differences \
above 35 dB are hard to see). Episodes are compared by their place. Where the second dataset holds episodes of the first at \
another place, as after `swm split`, that is said.

Options of datasets of other programs are those of the first dataset.

Exit status 1 if they differ.")]
pub(super) struct Diff {
    /// The first dataset.
    first: PathBuf,
    /// The second dataset.
    second: PathBuf,
    /// Largest accepted absolute difference of values.
    #[arg(long, default_value_t = 0.0)]
    tolerance: f64,
    /// Only these columns.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "ignore")]
    columns: Vec<String>,
    /// All columns but these.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    ignore: Vec<String>,
    #[command(flatten)]
    opening: OpenArgs,
}

impl Diff {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Diff {
            first: self.first,
            second: self.second,
            tolerance: self.tolerance,
            columns: self.columns,
            ignore: self.ignore,
            opening: self.opening.options()?,
        };
        let found = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&found, || {
            let mut text = String::new();
            if found.episodes[0] != found.episodes[1] {
                text += &format!(
                    "{} episodes in the first, {} in the second\n",
                    found.episodes[0], found.episodes[1]
                );
            }
            for line in &found.schema {
                text += &format!("{line}\n");
            }
            if let [episode, ..] = found.lengths[..] {
                text += &format!("{} episodes differ in length, first {episode}\n", found.lengths.len());
            }
            let different: Vec<_> = found.columns.iter().filter(|column| column.rows > 0).collect();
            if !different.is_empty() {
                let cells = different.iter().map(|column| {
                    let [episode, row] = column.first.unwrap_or_default();
                    vec![
                        column.name.clone(),
                        column.rows.to_string(),
                        amount(column),
                        format!("episode {episode}, row {row}"),
                        column.psnr.map_or(String::new(), |psnr| format!("{psnr:.1} dB")),
                    ]
                });
                let header = ["column", "rows that differ", "largest difference", "first", "PSNR"];
                text += &table(&header, cells);
            }
            text += &found.shared.map_or(String::new(), |shared| elsewhere(found.episodes, shared));
            let (first, second) = (request.first.display(), request.second.display());
            text + &format!("{first} and {second} {}", if found.equal { "are equal" } else { "differ" })
        })?;
        if found.equal { Ok(()) } else { Err(AlreadyReported.into()) }
    }
}

/// By how much a column differs.
fn amount(column: &ColumnComparison) -> String {
    let nan = || format!("NaN in one of them ({})", counted(column.nan_rows, "row"));
    match (column.largest, column.nan_rows) {
        (0.0, 0) => "texts".to_owned(),
        (0.0, _) => nan(),
        (f64::INFINITY, 0) => "infinite in one of them".to_owned(),
        (largest, 0) => compact(largest),
        (largest, _) => format!("{}, {}", compact(largest), nan()),
    }
}

/// What is said where episodes of the second dataset are in the first at another place.
fn elsewhere([first, second]: [usize; 2], SharedEpisodes { held, moved, .. }: SharedEpisodes) -> String {
    let told = match () {
        () if moved == 0 => return String::new(),
        () if held == second && first == second => "both hold the same episodes, in another order".to_owned(),
        () if held == second => {
            format!("every episode of the second is in the first, {moved} of {second} at another place")
        }
        () => format!(
            "{held} of the {second} episodes of the second are in the first, {moved} at another place"
        ),
    };
    format!("{told} (images are not compared for this)\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_without_a_size_is_named() {
        let of = |largest, nan_rows| {
            let mut column = ColumnComparison::default();
            (column.rows, column.largest, column.nan_rows) = (3, largest, nan_rows);
            amount(&column)
        };
        assert_eq!(of(0.25, 0), "0.2500");
        assert_eq!(of(0.0, 0), "texts");
        assert_eq!(of(0.0, 1), "NaN in one of them (1 row)");
        assert_eq!(of(2.0, 2), "2, NaN in one of them (2 rows)");
        assert_eq!(of(f64::INFINITY, 0), "infinite in one of them");
    }
}
