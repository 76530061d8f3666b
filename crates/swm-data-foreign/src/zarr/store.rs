//! Where a store of Zarr is: a folder, or a zip archive of the same files.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{self, Read as _};
use std::ops::Range;
use std::path::{Path, PathBuf};
#[cfg(feature = "remote")]
use std::sync::Arc;

use swm_data::error::{FormatError, Result, invalid, unsupported};
use swm_data::npz::check_end;
#[cfg(feature = "remote")]
use swm_files::remote::{self, Folder};
use swm_files::{Cursor, ReadAt as _, Readable, open_regular, read_exact_at};
use zip::ZipArchive;
use zip::result::ZipError;

use super::ENDS;
use crate::natural;

/// Descriptions of an array, in the versions 2 and 3.
pub(super) const V2: &str = ".zarray";
pub(super) const V3: &str = "zarr.json";
/// A description is never longer.
const MAX_ABOUT: u64 = 16 << 20;
/// A chunk is never larger: of Blosc's, none is.
const MAX_CHUNK: u64 = 1 << 31;
/// Entries of a folder that are looked at, and how deep groups are.
const MAX_ENTRIES: usize = 10_000;
const MAX_DEPTH: usize = 8;
/// The most that deflate can shrink by; what claims more is forged.
const MAX_RATIO: u64 = 1100;

/// An open store.
pub(super) enum Store {
    Folder(PathBuf),
    /// An archive, and the folder in it.
    Zip(ZipArchive<Cursor>, String),
    /// Objects that lie elsewhere.
    #[cfg(feature = "remote")]
    Remote(Arc<Folder>),
}

impl fmt::Debug for Store {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(path) => f.debug_tuple("Folder").field(path).finish(),
            Self::Zip(archive, folder) => f.debug_tuple("Zip").field(&archive.len()).field(folder).finish(),
            #[cfg(feature = "remote")]
            Self::Remote(folder) => folder.fmt(f),
        }
    }
}

impl Store {
    /// The store at `path`, if there is one with ends of episodes.
    pub(super) fn open(path: &Path) -> Result<Option<Self>> {
        #[cfg(feature = "remote")]
        if let Some(folder) = remote::folder(path) {
            let is_there = [V2, V3].iter().any(|about| folder.has(&format!("{ENDS}/{about}")));
            return Ok(is_there.then_some(Self::Remote(folder)));
        }
        if path.is_dir() {
            let is_there = [V2, V3].iter().any(|about| path.join(ENDS).join(about).is_file());
            return Ok(is_there.then(|| Self::Folder(path.to_owned())));
        }
        if !swm_files::is_zip(path) {
            return Ok(None);
        }
        let file = Readable::open(path)?;
        check_end(&file, file.length()?)?;
        let archive = ZipArchive::new(Cursor::new(file)?).map_err(zip_error)?;
        let ends = [V2, V3].map(|about| format!("{ENDS}/{about}"));
        let folder = archive.file_names().find_map(|name| {
            let folder = ends.iter().find_map(|end| name.strip_suffix(end.as_str()))?;
            (folder.is_empty() || folder.ends_with('/')).then(|| folder.to_owned())
        });
        Ok(folder.map(|folder| Self::Zip(archive, folder)))
    }

    /// The description of an array.
    pub(super) fn about(&self, array: &str, file: &str) -> Result<Option<Vec<u8>>> {
        let key = format!("{array}/{file}");
        match self.length(&key)? {
            Some(length) if length > MAX_ABOUT => Err(invalid(format!("`{key}` has {length} bytes"))),
            Some(_) => self.bytes(&key),
            None => Ok(None),
        }
    }

    /// Bytes of a file; `None` if there is none.
    pub(super) fn length(&self, key: &str) -> Result<Option<u64>> {
        match self {
            Self::Folder(folder) => match folder.join(key).metadata() {
                Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
                metadata => Ok(Some(metadata?.len())),
            },
            Self::Zip(archive, folder) => match archive.clone().by_name(&format!("{folder}{key}")) {
                Err(ZipError::FileNotFound) => Ok(None),
                entry => Ok(Some(entry.map_err(zip_error)?.size())),
            },
            #[cfg(feature = "remote")]
            Self::Remote(folder) => Ok(folder.length(key)?),
        }
    }

    /// A file; `None` if there is none.
    pub(super) fn bytes(&self, key: &str) -> Result<Option<Vec<u8>>> {
        self.read(key, None)
    }

    /// A part of a file; `None` if there is no such file.
    pub(super) fn part(&self, key: &str, range: Range<u64>) -> Result<Option<Vec<u8>>> {
        self.read(key, Some(&range))
    }

    fn read(&self, key: &str, range: Option<&Range<u64>>) -> Result<Option<Vec<u8>>> {
        let within = |length: u64| {
            let range = range.cloned().unwrap_or(0..length);
            match range.start <= range.end && range.end <= length && range.end - range.start <= MAX_CHUNK {
                true => Ok(range),
                false => Err(invalid(format!(
                    "`{key}`: the bytes {} to {} of {length} are asked for",
                    range.start, range.end
                ))),
            }
        };
        match self {
            Self::Folder(folder) => {
                let file = match open_regular(&folder.join(key)) {
                    Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
                    file => file?,
                };
                let range = within(file.metadata()?.len())?;
                let mut bytes = vec![0; (range.end - range.start) as usize];
                read_exact_at(&file, &mut bytes, range.start)?;
                Ok(Some(bytes))
            }
            Self::Zip(archive, folder) => {
                let (mut archive, length) = (archive.clone(), archive_length(archive));
                let mut entry = match archive.by_name(&format!("{folder}{key}")) {
                    Err(ZipError::FileNotFound) => return Ok(None),
                    entry => entry.map_err(zip_error)?,
                };
                let (size, stored) = (entry.size(), entry.compressed_size());
                if stored > length || size / MAX_RATIO > stored {
                    return Err(invalid(format!("`{key}` claims to have {size} bytes")));
                }
                let range = within(size)?;
                io::copy(&mut entry.by_ref().take(range.start), &mut io::sink())?;
                let mut bytes = Vec::new();
                entry.take(range.end - range.start).read_to_end(&mut bytes)?;
                match bytes.len() as u64 == range.end - range.start {
                    true => Ok(Some(bytes)),
                    false => Err(invalid(format!("`{key}` is cut short"))),
                }
            }
            #[cfg(feature = "remote")]
            Self::Remote(folder) => folder.part(key, within),
        }
    }

    /// The paths of all arrays below a group, in the order of their names. Groups of version 3 are among them, as only their
    /// descriptions tell.
    pub(super) fn arrays(&self, group: &str) -> Result<Vec<String>> {
        let mut found = BTreeSet::new();
        match self {
            Self::Folder(folder) => below(&folder.join(group), "", 0, &mut found)?,
            Self::Zip(archive, folder) => {
                let start = format!("{folder}{group}/");
                found.extend(archive.file_names().filter_map(|name| array_of(name, &start)));
            }
            #[cfg(feature = "remote")]
            Self::Remote(folder) => {
                let start = format!("{group}/");
                found.extend(folder.names().filter_map(|name| array_of(name, &start)));
            }
        }
        let mut found: Vec<String> = found.into_iter().filter(|path| self.is_array(group, path)).collect();
        found.sort_by_key(|path| natural(path));
        Ok(found)
    }

    /// Whether a description is of an array and not of a group.
    fn is_array(&self, group: &str, path: &str) -> bool {
        let about = self.about(&format!("{group}/{path}"), V3);
        let Ok(Some(about)) = about else { return true };
        let about: serde_json::Value = serde_json::from_slice(&about).unwrap_or_default();
        about["node_type"] != "group"
    }
}

/// The path of an array, of that of its description, below a group.
fn array_of(name: &str, start: &str) -> Option<String> {
    let path = name.strip_prefix(start)?;
    [V2, V3].iter().find_map(|about| path.strip_suffix(about)?.strip_suffix('/')).map(str::to_owned)
}

/// Arrays below a folder; what is below an array are its chunks.
fn below(folder: &Path, path: &str, depth: usize, found: &mut BTreeSet<String>) -> Result<()> {
    let entries = match folder.read_dir() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries.take(MAX_ENTRIES) {
        let entry = entry?;
        let (Some(name), true) = (entry.file_name().to_str().map(str::to_owned), entry.path().is_dir())
        else {
            continue;
        };
        let path = if path.is_empty() { name } else { format!("{path}/{name}") };
        let (second, third) = (entry.path().join(V2).is_file(), entry.path().join(V3).is_file());
        let is_group = entry.path().join(".zgroup").is_file() || third && is_group(&entry.path());
        if second || third {
            found.insert(path.clone());
        }
        if is_group && depth < MAX_DEPTH && found.len() < MAX_ENTRIES {
            below(&entry.path(), &path, depth + 1, found)?;
        }
    }
    Ok(())
}

fn is_group(folder: &Path) -> bool {
    let path = folder.join(V3);
    let is_small = path.metadata().is_ok_and(|metadata| metadata.len() <= MAX_ABOUT);
    let about = is_small.then(|| std::fs::read(path).ok()).flatten().unwrap_or_default();
    let about: serde_json::Value = serde_json::from_slice(&about).unwrap_or_default();
    about["node_type"] == "group"
}

fn archive_length(archive: &ZipArchive<Cursor>) -> u64 {
    archive.clone().into_inner().length()
}

fn zip_error(error: ZipError) -> FormatError {
    match error {
        ZipError::UnsupportedArchive(what) => {
            unsupported(format!("an archive of this kind is not read: {what}"))
        }
        error => FormatError::other(error),
    }
}
