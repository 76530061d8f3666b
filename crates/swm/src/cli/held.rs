//! Results that a folder holds already: the same evaluation is not run twice, another one does not replace it.

use std::path::Path;

use super::{Failure, usage};
use crate::evaluation::{self, Candidate, Receipt, Role};

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

/// Refuses to replace what `dir` holds.
pub(super) fn refusal(dir: &Path, holds: &str) -> Failure {
    usage(evaluation::refusal(dir, holds))
}
