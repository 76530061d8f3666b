//! The engines, one in each file.

pub(super) mod hq;
pub(super) mod script;
pub(super) mod slurm;

use super::JobFolder;
use super::process::quoted;

/// The beginning of the commands of tasks: `JOB/swm task JOB`.
fn task(folder: &JobFolder) -> String {
    let [program, dir] =
        [folder.program(), folder.dir.clone()].map(|path| quoted(&path.display().to_string()));
    format!("{program} task {dir}")
}
