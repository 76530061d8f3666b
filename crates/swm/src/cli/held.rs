//! Results that a folder holds already: the same evaluation is not run twice, another one does not replace it.

use std::path::Path;

use super::{Failure, usage};
use crate::evaluation::{self, Candidate, Receipt, Role, Sweep};
use crate::text_file::{json_error, read_text};

/// The receipt that `dir` holds of the evaluation that `asked` describes, if there is one. `roles` are the reference
/// policies that are asked for; those that it lacks are left.
///
/// # Errors
///
/// The folder holds the result of another evaluation.
pub(super) fn receipt(
    dir: &Path,
    asked: &Receipt,
    roles: &mut Vec<(Role, Candidate)>,
) -> Result<Option<Receipt>, Failure> {
    evaluation::held_receipt(dir, asked, roles).map_err(usage)
}

/// The sweep that `dir` holds, if there is one.
///
/// # Errors
///
/// The file cannot be read.
pub(super) fn sweep(dir: &Path) -> Result<Option<Sweep>, Failure> {
    let path = dir.join("sweep.json");
    if !path.is_file() {
        return Ok(None);
    }
    let text = read_text(&path).map_err(|error| error.to_string());
    let held = text.and_then(|text| serde_json::from_str(&text).map_err(|error| json_error(&text, &error)));
    Ok(Some(held.map_err(|error| refusal(dir, &format!("a file that cannot be read ({error})")))?))
}

/// Refuses to replace what `dir` holds.
pub(super) fn refusal(dir: &Path, holds: &str) -> Failure {
    usage(evaluation::refusal(dir, holds))
}
