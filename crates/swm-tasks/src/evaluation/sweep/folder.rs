//! The folder of a sweep: `sweep.json`, `sweep.csv` and `sweep.svg`, and whether what it holds is what is asked for.

use std::collections::BTreeMap;
use std::path::Path;

use swm_core::Manifest;

use super::{Change, Sweep, Values};
use crate::error::{TaskError, cannot};
use crate::evaluation::difference::hashes;
use crate::evaluation::existing_result::refusal;
use crate::evaluation::run::Candidate;
use crate::report_page::sweep_figure;
use crate::text_file::{json_error, read_text, replace_text};

/// Writes a sweep into the folder `dir`: as JSON, as a table and as a figure. Existing files are replaced.
///
/// # Errors
///
/// A file cannot be written.
pub fn write_sweep(dir: &Path, sweep: &Sweep) -> Result<(), TaskError> {
    let write = |name: &str, text: &str| {
        let path = dir.join(name);
        replace_text(&path, text).map_err(cannot("write", &path))
    };
    write("sweep.json", &(serde_json::to_string_pretty(sweep)? + "\n"))?;
    write("sweep.csv", &sweep.csv())?;
    Ok(write("sweep.svg", &sweep_figure(sweep))?)
}

/// Reads a sweep, from its file or the folder that it lies in.
///
/// # Errors
///
/// The file cannot be read, or is no sweep.
pub fn read_sweep(path: &Path) -> Result<Sweep, TaskError> {
    let path = if path.is_dir() { path.join("sweep.json") } else { path.to_owned() };
    let text = read_text(&path).map_err(cannot("read the sweep", &path))?;
    Ok(serde_json::from_str(&text)
        .map_err(|error| format!("{} is no sweep: {}", path.display(), json_error(&text, &error)))?)
}

/// The sweep that `dir` holds, if it is the one that is asked for; `files` are those of the policy, by their hashes.
///
/// # Errors
///
/// The folder holds another sweep, or a file that cannot be read.
pub fn existing_sweep(
    dir: &Path,
    manifest: &Manifest,
    candidate: &Candidate,
    files: &BTreeMap<String, String>,
    values: Values,
    changes: &[Change],
) -> Result<Option<Sweep>, TaskError> {
    if !dir.join("sweep.json").is_file() {
        return Ok(None);
    }
    let held =
        read_sweep(dir).map_err(|error| refusal(dir, &format!("a file that cannot be read ({error})")))?;
    let held_changes = held.cells.iter().skip(1).map(|cell| cell.name.as_str());
    let difference = if held.manifest_hash != manifest.hash() {
        "another manifest".to_owned()
    } else if held.candidate.policy != candidate.policy {
        format!("policy `{}`, not `{}`", held.candidate.policy, candidate.policy)
    } else if held.candidate != *candidate {
        format!("policy seed {}, not {}", held.candidate.seed, candidate.seed)
    } else if !held.files.is_empty() && hashes(&held.files) != hashes(files) {
        "other files of its model: they have changed since".to_owned()
    } else if held.values != values || !held_changes.eq(changes.iter().map(Change::name)) {
        "other factors or values".to_owned()
    } else {
        return Ok(Some(held));
    };
    Err(refusal(dir, &format!("the result of a sweep with {difference}")))
}
