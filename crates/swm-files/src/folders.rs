//! What folders have: names, links, bytes.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The first symbolic link below a folder that leads to where `is_allowed` is false, or nowhere.
///
/// # Errors
///
/// A folder cannot be read.
pub fn link_out_of(folder: &Path, is_allowed: &impl Fn(&Path) -> bool) -> io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (kind, path) = (entry.file_type()?, entry.path());
        if kind.is_symlink() {
            // What is behind an allowed link to a folder may have links, too; loops end, as they lead to what is looked at already.
            match fs::canonicalize(&path) {
                Ok(real) if is_allowed(&real) && !folder.starts_with(&real) => {
                    if real.is_dir()
                        && let Some(found) = link_out_of(&real, is_allowed)?
                    {
                        return Ok(Some(found));
                    }
                }
                _ => return Ok(Some(path)),
            }
        } else if kind.is_dir()
            && let Some(found) = link_out_of(&path, is_allowed)?
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Bytes of a file, or of all files of a folder; links are not followed.
///
/// # Errors
///
/// A folder cannot be read.
pub fn size(path: &Path) -> io::Result<u64> {
    let there = fs::symlink_metadata(path)?;
    if there.is_symlink() || !there.is_dir() {
        // A dataset that is a link is opened by it.
        return Ok(fs::metadata(path)?.len());
    }
    let mut bytes = 0u64;
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        bytes = bytes.saturating_add(match entry.file_type()? {
            kind if kind.is_dir() => size(&entry.path())?,
            _ => entry.metadata()?.len(),
        });
    }
    Ok(bytes)
}

/// The first symbolic link below a folder.
///
/// # Errors
///
/// A folder cannot be read.
pub fn first_link(folder: &Path) -> io::Result<Option<PathBuf>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_symlink() {
            return Ok(Some(entry.path()));
        }
        if kind.is_dir()
            && let Some(found) = first_link(&entry.path())?
        {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// `folder/name.h5` → `folder/name.h5.lock`.
#[must_use]
pub fn beside(dataset: &Path, suffix: &str) -> PathBuf {
    let mut name = dataset.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// The folder that a file lies in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether `name` stays in the folder that it is joined to, on every system.
#[must_use]
pub fn is_plain_name(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', '\0', ':'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_leave_the_folder() {
        for name in ["", ".", "..", "../x", "/etc", "a/b", "a\\b", "c:x", "a\0"] {
            assert!(!is_plain_name(name), "{name:?}");
        }
        assert!(is_plain_name("variation.block.color") && is_plain_name("..."));
    }
}
