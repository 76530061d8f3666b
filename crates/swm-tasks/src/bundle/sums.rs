//! The list of SHA-256 in a bundle, written and compared.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Component, Path};

use swm_core::evaluate::sha256_of;
use swm_files::{open_beneath, replace};

use super::SUMS;
use crate::error::{TaskError, cannot};
use crate::text_file::read_text;

/// Of a list of files that differ, so many are named.
const MAX_NAMED: usize = 5;

/// Writes the list of all files below `folder`.
pub(super) fn write(folder: &Path) -> Result<usize, TaskError> {
    let mut text = String::new();
    let files = files_below(folder, true)?;
    for path in &files {
        let hash = hash(folder, path).map_err(|error| format!("cannot read {path}: {error}"))?;
        text += &format!("{hash}  {path}\n");
    }
    replace(&folder.join(SUMS), text.as_bytes())?;
    Ok(files.len())
}

/// Compares all files of the bundle `folder` with its list; gives how many there are.
///
/// # Errors
///
/// A file was changed, is missing, or is not listed: the message names it. Names that begin with a dot are passed over, as systems and
/// tools leave such files.
pub(super) fn check(folder: &Path) -> Result<usize, TaskError> {
    let shown = folder.display();
    let path = folder.join(SUMS);
    let text = read_text(&path).map_err(|error| format!("bundle {shown}: cannot read {SUMS}: {error}"))?;
    let listed = read(&text).map_err(|reason| format!("bundle {shown}: {SUMS}: {reason}"))?;
    let mut wrong = Vec::new();
    for (path, expected) in &listed {
        match hash(folder, path) {
            Ok(found) if found == *expected => {}
            Ok(_) => wrong.push(format!("{path} was changed: its SHA-256 is not the one in {SUMS}")),
            Err(error) if error.kind() == io::ErrorKind::NotFound => wrong.push(format!("{path} is missing")),
            Err(error) => wrong.push(format!("{path} cannot be read: {error}")),
        }
    }
    let found = files_below(folder, false)?;
    let more = found.iter().filter(|path| *path != SUMS && !listed.contains_key(*path));
    wrong.extend(more.map(|path| format!("{path} is no part of it; remove it")));
    if wrong.is_empty() {
        return Ok(listed.len());
    }
    let more = wrong.len().saturating_sub(MAX_NAMED);
    wrong.truncate(MAX_NAMED);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    Err(format!("bundle {shown}: {}{more}; get the bundle again, or make it anew", wrong.join("; ")).into())
}

/// Hashes by path.
fn read(text: &str) -> Result<BTreeMap<String, String>, String> {
    let mut listed = BTreeMap::new();
    for (index, line) in text.lines().enumerate() {
        let wrong = |reason: &str| format!("line {}: {reason}", index + 1);
        let (hash, path) =
            line.split_once("  ").ok_or_else(|| wrong("must be a SHA-256, two blanks and a path"))?;
        if hash.len() != 64
            || !hash.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
        {
            return Err(wrong("begins with no SHA-256"));
        }
        if !is_inside(path) {
            return Err(wrong("its path leads out of the folder"));
        }
        if listed.insert(path.to_owned(), hash.to_owned()).is_some() {
            return Err(wrong("its path is listed twice"));
        }
    }
    match listed.is_empty() {
        true => Err("it lists nothing".to_owned()),
        false => Ok(listed),
    }
}

/// Whether a path can only lead to what is in the folder that it counts from.
pub(super) fn is_inside(path: &str) -> bool {
    let plain = |part: Component<'_>| matches!(part, Component::Normal(_));
    !path.is_empty() && Path::new(path).components().all(plain)
}

fn hash(folder: &Path, path: &str) -> io::Result<String> {
    open_beneath(folder, Path::new(path)).and_then(sha256_of)
}

/// Paths of all files below a folder, in order, with `/` between their parts; `hidden`: those whose names begin with a dot, too.
fn files_below(folder: &Path, hidden: bool) -> Result<Vec<String>, TaskError> {
    fn collect(folder: &Path, before: &str, hidden: bool, found: &mut Vec<String>) -> Result<(), TaskError> {
        let failed = cannot("read", folder);
        for entry in fs::read_dir(folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let name = name
                .to_str()
                .ok_or_else(|| format!("{} has a name that is no text", entry.path().display()))?;
            if name.starts_with('.') && !hidden {
                continue;
            }
            let path = format!("{before}{name}");
            if entry.file_type().map_err(failed)?.is_dir() {
                collect(&entry.path(), &format!("{path}/"), hidden, found)?;
            } else {
                found.push(path);
            }
        }
        Ok(())
    }
    let mut found = Vec::new();
    collect(folder, "", hidden, &mut found)?;
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_checked_before_any_file_is_read() {
        let hash = "0".repeat(64);
        assert_eq!(read(&format!("{hash}  a/b.json\n")).unwrap()["a/b.json"], hash);
        for (text, told) in [
            (String::new(), "it lists nothing"),
            (format!("{hash} a"), "line 1: must be a SHA-256"),
            (format!("{}  a", &hash[1..]), "begins with no SHA-256"),
            (format!("{}  a", "G".repeat(64)), "begins with no SHA-256"),
            (format!("{hash}  ../a"), "leads out of the folder"),
            (format!("{hash}  /etc/passwd"), "leads out of the folder"),
            (format!("{hash}  a\n{hash}  a"), "line 2: its path is listed twice"),
        ] {
            let said = read(&text).unwrap_err();
            assert!(said.contains(told), "{said}");
        }
    }

    #[test]
    fn every_change_is_reported_by_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("model")).unwrap();
        fs::write(at("model/weights"), [1, 2, 3]).unwrap();
        fs::write(at("README.md"), "a").unwrap();
        assert_eq!(write(folder.path()).unwrap(), 2);
        assert_eq!(check(folder.path()).unwrap(), 2);
        fs::write(at(".DS_Store"), "left by a system").unwrap();
        assert_eq!(check(folder.path()).unwrap(), 2);
        fs::write(at("model/weights"), [1, 2, 4]).unwrap();
        let said = || check(folder.path()).unwrap_err().to_string();
        assert!(said().contains("model/weights was changed") && !said().contains("README"), "{}", said());
        fs::remove_file(at("model/weights")).unwrap();
        assert!(said().contains("model/weights is missing"), "{}", said());
        fs::write(at("model/weights"), [1, 2, 3]).unwrap();
        fs::write(at("model/more"), "").unwrap();
        assert!(said().contains("model/more is no part of it; remove it"), "{}", said());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_out_of_the_bundle_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (bundle, outside) = (folder.path().join("bundle"), folder.path().join("outside"));
        fs::create_dir(&bundle).unwrap();
        fs::write(bundle.join("a"), "same").unwrap();
        fs::write(&outside, "same").unwrap();
        write(&bundle).unwrap();
        fs::remove_file(bundle.join("a")).unwrap();
        std::os::unix::fs::symlink(&outside, bundle.join("a")).unwrap();
        let said = check(&bundle).unwrap_err().to_string();
        assert!(said.contains("a cannot be read"), "{said}");
    }
}
