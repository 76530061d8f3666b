//! The files of models in a bundle: copied, and arguments of policies that name them, rewritten to paths in the folder and back.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::PolicyArgs;

use crate::error::{TaskError, cannot};
use crate::evaluation::file_hash;

/// Models that were copied into a bundle.
pub(super) struct Models<'a> {
    folder: &'a Path,
    /// Where each argument's model lies in the folder, by the argument.
    placed: BTreeMap<String, String>,
    /// Where each file lies in the folder, by its path as receipts have it.
    files: BTreeMap<String, String>,
}

impl<'a> Models<'a> {
    /// No model yet, in a bundle at `folder`.
    pub(super) fn new(folder: &'a Path) -> Self {
        Self { folder, placed: BTreeMap::new(), files: BTreeMap::new() }
    }

    /// Copies `files`, which a policy with these arguments depends on, and rewrites the arguments that name them. `hashes`: what the
    /// content must be, by path.
    ///
    /// # Errors
    ///
    /// A file is not there, was changed, or no argument names it.
    pub(super) fn place(
        &mut self,
        args: &mut PolicyArgs,
        files: &[PathBuf],
        hashes: &BTreeMap<String, String>,
    ) -> Result<(), TaskError> {
        for file in files {
            let argument = values(args).find(|text| file.starts_with(text)).map(str::to_owned);
            let Some(argument) = argument else {
                let (file, name) = (file.display(), &args.name);
                return Err(format!(
                    "{name} depends on {file}, which none of its arguments names: it cannot be bundled"
                )
                .into());
            };
            let root = self.root_of(&argument, file);
            let target = match file.strip_prefix(&argument) {
                Ok(below) if !below.as_os_str().is_empty() => joined(&root, below)?,
                _ => root,
            };
            self.copy(file, &target, hashes)?;
        }
        for value in args.positional.iter_mut().chain(args.named.values_mut()) {
            if let Some(place) = value.as_str().and_then(|text| self.placed.get(text)) {
                *value = Json::from(place.as_str());
            }
        }
        Ok(())
    }

    /// Copies files that belong to a policy of another program.
    ///
    /// # Errors
    ///
    /// A file is not there, or was changed.
    pub(super) fn place_apart(&mut self, hashes: &BTreeMap<String, String>) -> Result<(), TaskError> {
        for file in hashes.keys() {
            let path = Path::new(file);
            let target = self.free(path);
            self.copy(path, &target, hashes)?;
        }
        Ok(())
    }

    /// The arguments' paths in the folder, in order.
    pub(super) fn paths(&self) -> Vec<String> {
        let mut paths: Vec<String> = self.placed.values().cloned().collect();
        paths.sort();
        paths
    }

    /// The hashes of a receipt, with the paths in the folder.
    pub(super) fn hashes(&self, recorded: &BTreeMap<String, String>) -> BTreeMap<String, String> {
        let here = |path: &String| self.files.get(path).unwrap_or(path).clone();
        recorded.iter().map(|(path, hash)| (here(path), hash.clone())).collect()
    }

    /// Where what an argument names lies: a run's folder in `model`, a file in it.
    fn root_of(&mut self, argument: &str, file: &Path) -> String {
        if let Some(known) = self.placed.get(argument) {
            return known.clone();
        }
        let is_file = Path::new(argument) == file && file.is_file();
        let root = match is_file {
            true => self.free(file),
            false if self.placed.is_empty() => "model".to_owned(),
            false => format!("model-{}", self.placed.len() + 1),
        };
        self.placed.insert(argument.to_owned(), root.clone());
        root
    }

    /// A path in the folder that nothing has yet, for a file that is named itself.
    fn free(&self, file: &Path) -> String {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let mut places = (0..).map(|count| match count {
            0 => format!("model/{name}"),
            count => format!("model/{}/{name}", count + 1),
        });
        places.find(|place| !self.files.values().any(|taken| taken == place)).unwrap_or_default()
    }

    fn copy(
        &mut self,
        file: &Path,
        target: &str,
        hashes: &BTreeMap<String, String>,
    ) -> Result<(), TaskError> {
        let (shown, to) = (file.display().to_string(), self.folder.join(target));
        if self.files.contains_key(&shown) {
            return Ok(());
        }
        let missing = |error: TaskError| {
            match file.exists() {
            true => error,
            false => format!(
                "{shown}, which the result depends on, is not there; a relative path counts from the folder in which the policy was evaluated"
            )
            .into(),
        }
        };
        copy_all(file, &to).map_err(missing)?;
        if let Some(recorded) = hashes.get(&shown)
            && file_hash(&to)? != *recorded
        {
            return Err(format!(
                "{shown} was changed since the evaluation: its SHA-256 is not the receipt's; bring back the file, or evaluate again"
            )
            .into());
        }
        self.files.insert(shown, target.to_owned());
        Ok(())
    }
}

/// Texts among the arguments.
fn values(args: &PolicyArgs) -> impl Iterator<Item = &str> {
    args.positional.iter().chain(args.named.values()).filter_map(Json::as_str).filter(|text| !text.is_empty())
}

/// Rewrites arguments that are `paths` in a bundle to paths below `folder`.
pub(super) fn resolve(args: &mut PolicyArgs, paths: &[String], folder: &Path) {
    for value in args.positional.iter_mut().chain(args.named.values_mut()) {
        if let Some(text) = value.as_str().filter(|text| paths.iter().any(|path| path == text)) {
            *value = folder.join(text).display().to_string().into();
        }
    }
}

/// A path below `root`, with `/` between its parts.
fn joined(root: &str, below: &Path) -> Result<String, TaskError> {
    let mut path = root.to_owned();
    for part in below.components() {
        let part = part.as_os_str().to_str().ok_or_else(|| format!("{} is no text", below.display()))?;
        path = format!("{path}/{part}");
    }
    Ok(path)
}

/// Copies a file, or a folder with all that is in it.
fn copy_all(from: &Path, to: &Path) -> Result<(), TaskError> {
    let failed = cannot("copy", from);
    if from.is_dir() {
        fs::create_dir_all(to).map_err(failed)?;
        for entry in fs::read_dir(from).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            copy_all(&entry.path(), &to.join(entry.file_name()))?;
        }
        return Ok(());
    }
    if !fs::metadata(from).map_err(failed)?.is_file() {
        return Err(format!("cannot copy {}: it is no regular file", from.display()).into());
    }
    if let Some(parent) = to.parent() {
        fs::create_dir_all(parent).map_err(failed)?;
    }
    // Not the permissions: a model that nobody may write cannot be removed with the rest.
    let mut source = fs::File::open(from).map_err(failed)?;
    let mut target = fs::File::create_new(to).map_err(failed)?;
    std::io::copy(&mut source, &mut target).map_err(failed)?;
    Ok(target.sync_all().map_err(failed)?)
}
