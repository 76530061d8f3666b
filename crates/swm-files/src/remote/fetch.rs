//! Fetching a dataset to a place of one's own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::address::Address;
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::found::{Found, Remote};
use crate::folders::{beside, is_plain_name};

/// What was fetched.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Fetched {
    /// What it is called there.
    pub name: String,
    /// Where it is here.
    pub path: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Its files.
    pub files: usize,
}

/// Fetches a file or a folder to `out`; by default, under its own name into the current folder. What was interrupted is continued, as
/// long as the object is the same version. Its address may hold a query with credentials, which are not stored.
///
/// # Errors
///
/// Something is at `out`; or it cannot be reached, changes meanwhile, or cannot be written.
pub fn fetch(address: &Path, out: Option<&Path>) -> Result<Fetched, RemoteError> {
    fetch_from(&Remote::global()?, address, out)
}

pub(super) fn fetch_from(
    remote: &Arc<Remote>,
    address: &Path,
    out: Option<&Path>,
) -> Result<Fetched, RemoteError> {
    let address = Address::of_any(address)?;
    let (name, file_name) = (address.name(), address.file_name());
    let refuse = |reason: String, fix: &str| Err(RemoteError::new(Kind::Address, &name, reason, fix));
    let out = match out {
        Some(out) => out.to_owned(),
        None if is_plain_name(file_name) => PathBuf::from(file_name),
        None => return refuse("its address ends with no name for a file".to_owned(), "name one by `out`"),
    };
    if out.exists() {
        return refuse(
            format!("{} exists already", out.display()),
            "remove it, or name another place by `out`",
        );
    }
    let found = remote.find(&address)?;
    let files = match &found {
        Found::Object(_) => 1,
        Found::Folder(folder) => folder.files().map_or(0, BTreeMap::len),
    };
    // A version that nothing tells from others is not continued.
    let (key, is_known) = found.key().map_or(("unknown".to_owned(), false), |key| (key, true));
    if !is_known {
        let draft = beside(&out, ".unknown.part");
        let _ = std::fs::remove_file(draft);
    }
    found.copy(&name, &out, &key)?;
    Ok(Fetched { name, path: out, bytes: found.bytes(), files })
}
