//! The folder of a trace: new, or emptied of an earlier one.

use std::fs;
use std::path::{Path, PathBuf};

use swm_data::DataError;
use swm_files::WriterLock;

use crate::request::{Fix, Message, TaskError, wrong};

/// Why nothing can be written to the folder.
pub(super) fn unwritable(dir: &Path, error: &std::io::Error) -> TaskError {
    wrong(format!("cannot write to the folder {}: {error}", dir.display()))
}

/// Keeps other processes from the folder, which need not be there yet, until the lock is dropped.
pub(super) fn claim(dir: &Path) -> Result<WriterLock, TaskError> {
    match WriterLock::take(dir) {
        Err(DataError::Io { source, .. }) => Err(unwritable(dir, &source)),
        taken => Ok(taken?),
    }
}

/// Makes the folder, or empties it of an earlier report: of nothing else.
pub(super) fn prepare(dir: &Path, overwrite: bool) -> Result<(), TaskError> {
    let failed = |error| unwritable(dir, &error);
    fs::create_dir_all(dir).map_err(failed)?;
    let files: Vec<PathBuf> = fs::read_dir(dir)
        .and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect())
        .map_err(failed)?;
    if files.is_empty() {
        return Ok(());
    }
    let refused = |reason: &str, fix: Fix| {
        Err(Message::new(format!("the folder {} {reason}", dir.display())).fix(fix).into())
    };
    if !overwrite {
        let replace = Fix::set_to("overwrite", true, "to replace an earlier trace in it");
        return refused("is not empty", Fix::Any(vec![Fix::Change("trace"), replace]));
    }
    if !dir.join("trace.jsonl").is_file() {
        let reason = "holds no earlier trace (trace.jsonl), so nothing in it is replaced";
        return refused(reason, Fix::Change("trace"));
    }
    let ours = |path: &&PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        ["index.html", "costs.svg", "result.json", "trace.jsonl"].contains(&name.as_ref())
            || (name.starts_with("episode_")
                && [".svg", ".gif", ".mp4"].iter().any(|end| name.ends_with(end)))
    };
    files.iter().filter(ours).try_for_each(fs::remove_file).map_err(failed)
}
