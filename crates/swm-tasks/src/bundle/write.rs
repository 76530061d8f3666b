//! Writing a bundle: into a draft beside its place, which is renamed when it is whole.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Registry;

use super::models::Models;
use super::{BUNDLE_VERSION, BundleInfo, CARD, INFO, MANIFEST, README, Reported, readme, sums};
use crate::error::{TaskError, cannot};
use crate::evaluation::{Candidate, Code, Receipt, contradiction, env_of, write_manifest, write_receipt};
use crate::zoo;

/// Writes a bundle of `receipt` to the folder `out`, which must not be there; gives how many files it has.
///
/// # Errors
///
/// Something is at `out`; the receipt contradicts itself; a model is not there, was changed, or cannot be found by the policy's
/// arguments; this program does not know the environment; or a file cannot be written. Nothing is left then.
pub fn write_bundle(
    registry: &Registry,
    receipt: &Receipt,
    out: &Path,
    license: Option<String>,
    reported: Option<Reported>,
) -> Result<usize, TaskError> {
    let shown = out.display();
    if fs::symlink_metadata(out).is_ok() {
        return Err(format!("{shown} exists; name a folder that is not there yet").into());
    }
    if let Some(reason) = contradiction(receipt) {
        return Err(format!("the receipt was edited: {reason}; evaluate again").into());
    }
    let draft = swm_files::draft(out);
    fs::create_dir(&draft).map_err(cannot("make", &draft))?;
    let written = write_all(registry, receipt, &draft, license, reported).and_then(|count| {
        // A folder that somebody made meanwhile is kept: renaming replaces empty ones alone.
        swm_files::settle(&draft, out).map_err(cannot("write", out))?;
        Ok(count)
    });
    written.inspect_err(|_| drop(fs::remove_dir_all(&draft)))
}

fn write_all(
    registry: &Registry,
    receipt: &Receipt,
    folder: &Path,
    license: Option<String>,
    reported: Option<Reported>,
) -> Result<usize, TaskError> {
    let entry = env_of(registry, &receipt.manifest)?;
    let mut receipt = receipt.clone();
    // Names of the zoo become files, so that the bundle is verified where no zoo is.
    for policy in std::iter::once(&mut receipt.candidate)
        .chain(receipt.references.iter_mut().map(|one| &mut one.candidate))
    {
        policy.policy = zoo::expanded(&policy.policy)?;
    }
    let is_foreign = match registry.policy_entry(entry, &receipt.candidate.policy.name) {
        Ok(_) => false,
        Err(unknown) if unknown.fix.is_some() => return Err(unknown.into()),
        Err(_) => true,
    };
    let mut models = Models::new(folder);
    if is_foreign {
        models.place_apart(&receipt.files)?;
    } else {
        let files = needed(registry, &receipt, &receipt.candidate)?;
        models.place(&mut receipt.candidate.policy, &files, &receipt.files)?;
    }
    for reference in &mut receipt.references {
        let entry = registry.policy_entry(entry, &reference.candidate.policy.name)?;
        let args = &reference.candidate.policy;
        let files = [entry.model_files(args)?, entry.companion_files(args)?].concat();
        models.place(&mut reference.candidate.policy, &files, &BTreeMap::new())?;
    }
    receipt.files = models.hashes(&receipt.files);
    let info = BundleInfo {
        bundle: BUNDLE_VERSION,
        env: receipt.manifest.env.clone(),
        manifest_hash: receipt.manifest_hash.clone(),
        policy: receipt.candidate.policy.to_string(),
        is_foreign,
        code: receipt.code.clone(),
        bundled_by: Code::this(),
        made_from: receipt.fingerprints.made_from.clone(),
        paths: models.paths(),
        license,
        reported,
    };
    write_manifest(&folder.join(MANIFEST), &receipt.manifest)?;
    write_receipt(folder, &receipt)?;
    write_text(&folder.join(INFO), &(serde_json::to_string_pretty(&info)? + "\n"))?;
    if !receipt.files.is_empty() {
        write_text(&folder.join(CARD), &readme::card(&receipt, &info)?)?;
    }
    write_text(&folder.join(README), &readme::readme(&receipt, &info)?)?;
    sums::write(folder)
}

/// The files of a policy: those that the receipt has hashes of, and what it takes beside them to make it again.
fn needed(registry: &Registry, receipt: &Receipt, candidate: &Candidate) -> Result<Vec<PathBuf>, TaskError> {
    let entry = registry.policy_entry(env_of(registry, &receipt.manifest)?, &candidate.policy.name)?;
    let mut files: Vec<PathBuf> = receipt.files.keys().map(PathBuf::from).collect();
    if !files.is_empty() {
        // Those of a run that has gone on, or that is gone, are distinguished by their hashes: as files that are not there.
        files.extend(entry.companion_files(&candidate.policy)?);
    }
    Ok(files)
}

fn write_text(path: &Path, text: &str) -> Result<(), TaskError> {
    Ok(swm_files::replace(path, text.as_bytes()).map_err(cannot("write", path))?)
}
