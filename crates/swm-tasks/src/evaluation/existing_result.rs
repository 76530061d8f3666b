//! Existing results of a folder: the same evaluation is skipped, another one is an error.

use std::path::Path;

use super::files::read_receipt;
use super::receipt::Receipt;
use super::reference::Role;
use super::run::Candidate;
use crate::request::{Fix, Message, TaskError};

/// The receipt that `dir` holds of the evaluation that `asked` describes, if there is one. `roles` are the reference
/// policies that are asked for; the receipt may have others, and those that it lacks are left.
///
/// # Errors
///
/// The folder holds the result of another evaluation, or a receipt that cannot be read.
pub fn existing_receipt(
    dir: &Path,
    asked: &Receipt,
    roles: &mut Vec<(Role, Candidate)>,
) -> Result<Option<Receipt>, TaskError> {
    // Anything else of this name is found when the receipt is written.
    if !dir.join("receipt.json").is_file() {
        return Ok(None);
    }
    let held =
        read_receipt(dir).map_err(|error| refusal(dir, &format!("a file that cannot be read ({error})")))?;
    match difference(asked, &held, roles) {
        None => {
            roles.retain(|(role, _)| held.references.iter().all(|known| known.role != *role));
            Ok(Some(held))
        }
        Some(what) => Err(refusal(dir, &format!("the result of another evaluation: {what}"))),
    }
}

/// Why what `dir` holds is not replaced.
pub fn refusal(dir: &Path, holds: &str) -> TaskError {
    let replace = Fix::set_to("again", true, "to replace it");
    let message = Message::new(format!("{} holds {holds}", dir.display()));
    message.fix(Fix::Any(vec![Fix::Change("out"), replace])).into()
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
        Some(format!("policy seed {}, not {}", held.candidate.seed, asked.candidate.seed))
    } else if held.files != asked.files {
        Some("the files of its model have changed since".to_owned())
    } else if (&then.physics, &then.images) != (&now.physics, &now.images) {
        Some("the environment's physics or images have changed since".to_owned())
    } else if held.plan_steps != asked.plan_steps {
        let actions = if held.plan_steps == 1 { "action" } else { "actions" };
        Some(format!("plans of {} {actions}, not of {}", held.plan_steps, asked.plan_steps))
    } else {
        other_oracle.map(|known| format!("another oracle, `{}`", known.candidate.policy.name))
    }
}
