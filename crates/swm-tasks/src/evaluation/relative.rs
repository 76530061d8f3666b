//! Receipts that lie beside the model: paths from their own folder, which become paths from here when they are read.

use std::path::{Component, Path, PathBuf};

use super::receipt::Receipt;

/// Rewrites the paths of a receipt in `folder` that count from there.
///
/// # Errors
///
/// A path leads farther than to the folder above.
pub(super) fn resolve(receipt: &mut Receipt, folder: &Path) -> Result<(), String> {
    let paths = std::mem::take(&mut receipt.paths);
    if paths.is_empty() {
        return Ok(());
    }
    let here = |path: &str| {
        let from_here = from(folder, path).ok_or_else(|| {
            format!("the path {path} leads out of the folder that it was handed on in; get the folder again")
        })?;
        Ok::<_, String>(from_here.display().to_string())
    };
    let references = receipt.references.iter_mut().map(|reference| &mut reference.candidate);
    for candidate in std::iter::once(&mut receipt.candidate).chain(references) {
        let args = &mut candidate.policy;
        for value in args.positional.iter_mut().chain(args.named.values_mut()) {
            if let Some(text) = value.as_str().filter(|text| paths.iter().any(|path| path == text)) {
                *value = here(text)?.into();
            }
        }
    }
    let files = std::mem::take(&mut receipt.files);
    receipt.files =
        files.into_iter().map(|(path, hash)| Ok((here(&path)?, hash))).collect::<Result<_, String>>()?;
    Ok(())
}

/// `path` from `folder` on, which may begin with one step up; `None` if it leads elsewhere.
fn from(folder: &Path, path: &str) -> Option<PathBuf> {
    let mut found = folder.to_owned();
    for (index, part) in Path::new(path).components().enumerate() {
        match part {
            Component::Normal(part) => found.push(part),
            Component::ParentDir if index == 0 => match found.file_name() {
                Some(_) => drop(found.pop()),
                None => found.push(".."),
            },
            _ => return None,
        }
    }
    match found.as_os_str().is_empty() {
        true => Some(PathBuf::from(".")),
        false => Some(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_count_from_the_folder_of_the_receipt() {
        let told =
            |folder: &str, path: &str| from(Path::new(folder), path).map(|path| path.display().to_string());
        for (folder, path, expected) in [
            ("hub/results", "..", "hub"),
            ("hub/results", "../checkpoints/a", "hub/checkpoints/a"),
            ("results", "..", "."),
            ("results", "../a", "a"),
            ("", "..", ".."),
            ("", "a", "a"),
            ("/x/results", "a/b", "/x/results/a/b"),
        ] {
            assert_eq!(told(folder, path).as_deref(), Some(expected), "{folder} {path}");
        }
        for path in ["../..", "a/..", "/etc", "../a/../b"] {
            assert_eq!(told("hub/results", path), None, "{path}");
        }
    }
}
