//! Results that a folder holds already: the same evaluation is not run twice, another one does not replace it.

use std::path::Path;

use super::{Failure, usage};
use crate::evaluation::{Candidate, Receipt, Role, Sweep, read_receipt};
use crate::text_file::{json_error, read_text};

/// The receipt that `dir` holds of the evaluation that `asked` describes, if there is one. `roles` are the reference
/// policies that are asked for.
///
/// # Errors
///
/// The folder holds the result of another evaluation.
pub(super) fn receipt(
    dir: &Path,
    asked: &Receipt,
    roles: &[(Role, Candidate)],
) -> Result<Option<Receipt>, Failure> {
    // Anything else of this name is found when the receipt is written.
    if !dir.join("receipt.json").is_file() {
        return Ok(None);
    }
    let held =
        read_receipt(dir).map_err(|error| refusal(dir, &format!("a file that cannot be read ({error})")))?;
    match difference(asked, &held, roles) {
        None => Ok(Some(held)),
        Some(what) => Err(refusal(dir, &format!("the result of another evaluation: {what}"))),
    }
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
    let dir = dir.display();
    usage(format!("{dir} holds {holds}; give another folder, or --again to replace it"))
}

/// What a result has that is not asked for.
fn difference(asked: &Receipt, held: &Receipt, roles: &[(Role, Candidate)]) -> Option<String> {
    let (then, now) = (&held.fingerprints, &asked.fingerprints);
    let other_oracle = held.references.iter().find(|known| {
        roles.iter().any(|(role, candidate)| *role == known.role && *candidate != known.candidate)
    });
    if held.manifest_hash != asked.manifest_hash {
        Some(format!("the manifest {}, not {}", held.manifest_hash, asked.manifest_hash))
    } else if held.candidate.policy != asked.candidate.policy && held.policy != asked.policy {
        Some(format!("policy `{}`, not `{}`", held.candidate.policy, asked.candidate.policy))
    } else if held.candidate.seed != asked.candidate.seed {
        Some(format!("--policy-seed {}, not {}", held.candidate.seed, asked.candidate.seed))
    } else if held.files != asked.files {
        Some("the files of its model have changed since".to_owned())
    } else if (&then.physics, &then.images) != (&now.physics, &now.images) {
        Some("the environment's physics or images have changed since".to_owned())
    } else {
        other_oracle.map(|known| format!("another oracle, `{}`", known.candidate.policy.name))
    }
}
