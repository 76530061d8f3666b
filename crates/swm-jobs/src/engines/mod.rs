//! The engines, one in each file.

pub(crate) mod hq;
pub(crate) mod script;
pub(crate) mod slurm;

use crate::job::JobFolder;
use crate::process::quoted;

/// The beginning of the commands of tasks: `JOB/swm task JOB`, or `PYTHON -m PACKAGE task JOB`.
fn task(folder: &JobFolder) -> String {
    let words = folder.job.program.words(&folder.dir);
    let words = words.iter().map(|word| quoted(&word.to_string_lossy()));
    let dir = quoted(&folder.dir.display().to_string());
    format!("{} task {dir}", words.collect::<Vec<_>>().join(" "))
}
