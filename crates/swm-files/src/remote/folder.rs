//! A folder of objects that are read one by one.

use std::collections::BTreeSet;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::Value as Json;
use sha2::{Digest as _, Sha256};

use super::address::Address;
use super::client::Version;
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::found::{Found, Remote};
use super::list::{Entry, Files};
use super::object::{Object, key};
use super::sign::hex;

/// Finds the names of files in a description of a store.
type Names = fn(&Json) -> Option<BTreeSet<String>>;

/// An open folder.
#[derive(Debug)]
pub struct Folder {
    pub(super) remote: Arc<Remote>,
    /// With a commit, where it is of the Hub.
    pub(super) address: Address,
    contents: Contents,
    /// The object that was looked at last.
    last: Mutex<Option<(String, Option<Arc<Object>>)>>,
}

#[derive(Debug)]
enum Contents {
    /// All files.
    Listed(Files),
    /// Some files, of a server that gives no lists: those that the metadata of a Zarr store names.
    Known(BTreeSet<String>),
}

impl Folder {
    pub(super) fn listed(remote: &Arc<Remote>, address: Address, files: Files) -> Self {
        Self { remote: remote.clone(), address, contents: Contents::Listed(files), last: Mutex::default() }
    }

    /// A Zarr store of a server that gives no lists, if it has its metadata in one file.
    pub(super) fn consolidated(remote: &Arc<Remote>, address: &Address) -> Result<Option<Self>, RemoteError> {
        let kinds: [(&str, Names); 2] = [(".zmetadata", consolidated_2), ("zarr.json", consolidated_3)];
        for (file, of) in kinds {
            let at = address.join(file);
            match remote.client.text(&remote.link(&at)?) {
                Ok((text, _)) => {
                    let names: Option<BTreeSet<String>> =
                        of(&serde_json::from_slice(&text).unwrap_or_default());
                    let Some(names) = names.filter(|names| !names.is_empty()) else { continue };
                    let contents = Contents::Known(names);
                    let (remote, address) = (remote.clone(), address.clone());
                    return Ok(Some(Self { remote, address, contents, last: Mutex::default() }));
                }
                Err(error) if error.kind == Kind::Missing || error.kind == Kind::Denied => {}
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    /// Its files, unless its server gives no lists.
    pub(super) fn files(&self) -> Option<&Files> {
        match &self.contents {
            Contents::Listed(files) => Some(files),
            Contents::Known(_) => None,
        }
    }

    /// The paths of its files; at least of those that describe a Zarr store.
    #[must_use]
    pub fn names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        match &self.contents {
            Contents::Listed(files) => Box::new(files.keys().map(String::as_str)),
            Contents::Known(names) => Box::new(names.iter().map(String::as_str)),
        }
    }

    /// Its address.
    #[must_use]
    pub fn name(&self) -> String {
        self.address.name()
    }

    /// Another folder of the same server; `None` if nothing is there.
    ///
    /// # Errors
    ///
    /// It cannot be reached.
    pub fn beside(&self, path: &Path) -> io::Result<Option<Arc<Self>>> {
        match Address::of(path).and_then(|address| self.remote.find(&address)) {
            Ok(Found::Folder(folder)) => Ok(Some(folder)),
            Ok(Found::Object(_)) => Ok(None),
            Err(error) if error.kind == Kind::Missing || error.kind == Kind::Denied => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// What tells its version from others; `None` if nothing does.
    pub(super) fn key(&self) -> Option<String> {
        let files = self.files()?;
        let mut hash = Sha256::new();
        hash.update(self.address.name());
        for (path, Entry { size, version, .. }) in files {
            if version.is_empty() {
                return None;
            }
            hash.update(format!("\0{path}\0{size}\0{version}"));
        }
        Some(hex(&hash.finalize())[..32].to_owned())
    }

    /// One of the files of the list.
    pub(super) fn entry(&self, path: &str, entry: &Entry) -> Result<Object, RemoteError> {
        let link = self.remote.link(&self.address.join(path))?;
        let version = Version { length: entry.size, tag: entry.tag.clone() };
        let key = key(&link, entry.size, &entry.version);
        Ok(Object::known(&self.remote, link, version, key, entry.sha256.clone()))
    }

    fn object(&self, path: &str) -> Result<Option<Arc<Object>>, RemoteError> {
        let files = match &self.contents {
            Contents::Listed(files) => Some(files),
            Contents::Known(_) => None,
        };
        {
            let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some((_, found)) = last.as_ref().filter(|(there, _)| there == path) {
                return Ok(found.clone());
            }
        }
        let found = match files {
            Some(files) => files.get(path).map(|entry| self.entry(path, entry)).transpose()?,
            None => match Object::probe(&self.remote, self.remote.link(&self.address.join(path))?, None) {
                Ok(object) => Some(object),
                Err(error) if error.kind == Kind::Missing => None,
                Err(error) => return Err(error),
            },
        };
        let found = found.map(Arc::new);
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some((path.to_owned(), found.clone()));
        Ok(found)
    }

    /// Whether a file is there.
    #[must_use]
    pub fn has(&self, path: &str) -> bool {
        self.length(path).is_ok_and(|length| length.is_some())
    }

    /// Bytes of a file; `None` if there is none.
    ///
    /// # Errors
    ///
    /// It cannot be reached.
    pub fn length(&self, path: &str) -> io::Result<Option<u64>> {
        Ok(self.object(path)?.map(|object| object.length()))
    }

    /// A part of a file; `None` if there is no such file. `within` says which, by its length.
    ///
    /// # Errors
    ///
    /// It cannot be reached, or was changed after it was opened; or an error of `within`.
    pub fn part<E: From<io::Error>>(
        &self,
        path: &str,
        within: impl FnOnce(u64) -> Result<Range<u64>, E>,
    ) -> Result<Option<Vec<u8>>, E> {
        let object = self.object(path).map_err(io::Error::from)?;
        let Some(object) = object else { return Ok(None) };
        let range = within(object.length())?;
        let mut bytes = vec![0; range.end.saturating_sub(range.start) as usize];
        object.read_exact_at(&mut bytes, range.start)?;
        Ok(Some(bytes))
    }
}

/// Names of the descriptions in `.zmetadata`.
fn consolidated_2(about: &Json) -> Option<BTreeSet<String>> {
    Some(about["metadata"].as_object()?.keys().cloned().collect())
}

/// Names of the descriptions in the `zarr.json` of a group.
fn consolidated_3(about: &Json) -> Option<BTreeSet<String>> {
    let nodes = about["consolidated_metadata"]["metadata"].as_object()?;
    Some(nodes.keys().map(|path| format!("{path}/zarr.json")).collect())
}
