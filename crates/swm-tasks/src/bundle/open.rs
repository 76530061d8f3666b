//! A bundle that is there: its files compared with their hashes, its result with paths that can be opened from here.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::evaluate::sha256;
use swm_core::settings::read as read_settings;

use super::{BUNDLE_VERSION, BundleInfo, INFO, MANIFEST, RECEIPT, SUMS, models, sums};
use crate::error::{TaskError, cannot};
use crate::evaluation::{Receipt, read_manifest, read_receipt};
use crate::text_file::{json_error, read_text};

/// A bundle whose files are those that were written.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Bundle {
    /// Its folder.
    pub folder: PathBuf,
    /// What it holds.
    pub info: BundleInfo,
    /// Its result; models by paths that can be opened from here.
    pub receipt: Receipt,
    /// How many files were compared with their hashes.
    pub files: usize,
    /// SHA-256 of the list of hashes: the name of the bundle's content.
    pub hash: String,
}

impl Bundle {
    /// Opens the bundle in a folder, and compares the hashes of all of its files.
    ///
    /// # Errors
    ///
    /// It is no bundle of a version that this program reads; a file was changed, is missing, or is no part of it; or its manifest is not
    /// that of its receipt.
    pub fn open(folder: &Path) -> Result<Self, TaskError> {
        let shown = folder.display();
        let path = folder.join(INFO);
        if let Err(error) = std::fs::metadata(&path)
            && error.kind() == std::io::ErrorKind::PermissionDenied
        {
            return Err(cannot("read", &path)(error).into());
        }
        if !path.is_file() {
            let advice = match folder.join(RECEIPT).is_file() {
                true => "it is a result; `swm bundle` makes a bundle of it",
                false => "`swm bundle` makes one of a result",
            };
            return Err(format!("{shown} is no bundle: it has no {INFO}; {advice}").into());
        }
        let files = sums::check(folder)?;
        let hash = sha256(&std::fs::read(folder.join(SUMS))?);
        let info = read_info(&path)?;
        let (mut receipt, manifest) = (read_receipt(folder)?, read_manifest(&folder.join(MANIFEST))?);
        if [manifest.hash(), receipt.manifest.hash(), info.manifest_hash.clone()]
            .iter()
            .any(|hash| *hash != receipt.manifest_hash)
        {
            return Err(format!("bundle {shown}: its manifest is not the one of its receipt").into());
        }
        if let Some(path) = info.paths.iter().chain(receipt.files.keys()).find(|path| !sums::is_inside(path))
        {
            return Err(format!("bundle {shown}: the path {path} leads out of the folder").into());
        }
        models::resolve(&mut receipt.candidate.policy, &info.paths, folder);
        for reference in &mut receipt.references {
            models::resolve(&mut reference.candidate.policy, &info.paths, folder);
        }
        let files_here = receipt.files.iter();
        receipt.files =
            files_here.map(|(path, hash)| (folder.join(path).display().to_string(), hash.clone())).collect();
        Ok(Self { folder: folder.to_owned(), info, receipt, files, hash })
    }

    /// What the bundle is called: the name of its folder.
    pub fn name(&self) -> String {
        let named = self.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        named.unwrap_or_else(|| self.folder.display().to_string())
    }
}

/// The folder of the bundle that `path` names: the folder itself, or the receipt in it.
pub fn bundle_of(path: &Path) -> Option<&Path> {
    let folder = if path.ends_with(RECEIPT) { path.parent()? } else { path };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.join(INFO).is_file().then_some(folder)
}

/// The receipt at `path`, as it can be run again: of a bundle, after a comparison of its hashes; gives the bundle, too.
///
/// # Errors
///
/// As of [`Bundle::open`] and [`read_receipt`].
pub fn receipt_to_repeat(path: &Path) -> Result<(Receipt, Option<Bundle>), TaskError> {
    match bundle_of(path) {
        Some(folder) => {
            let bundle = Bundle::open(folder)?;
            Ok((bundle.receipt.clone(), Some(bundle)))
        }
        None => Ok((read_receipt(path)?, None)),
    }
}

fn read_info(path: &Path) -> Result<BundleInfo, TaskError> {
    let shown = path.display();
    let text = read_text(path).map_err(cannot("read", path))?;
    let json: Json =
        serde_json::from_str(&text).map_err(|error| format!("{shown}: {}", json_error(&text, &error)))?;
    match json.get("bundle").and_then(Json::as_u64) {
        Some(version) if version == u64::from(BUNDLE_VERSION) => {}
        Some(version) => {
            return Err(format!("{shown}: has version {version}, this program reads {BUNDLE_VERSION}").into());
        }
        None => return Err(format!("{shown}: describes no bundle").into()),
    }
    // Its version is one of its keys, so it is an object.
    let object = json.as_object().cloned().unwrap_or_default();
    Ok(read_settings(&object).map_err(|wrong| format!("{shown}: `{}`: {}", wrong.name, wrong.reason))?)
}
