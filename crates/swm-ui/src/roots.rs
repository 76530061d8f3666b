//! Which files may be read and written: those below the paths that the user gave, wherever links lead.

use std::collections::HashMap;
use std::fs;
use std::io::{ErrorKind, Read as _};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use serde::Serialize;
use serde_json::Value as Json;
use swm_core::{PolicyArgs, Registry};
use swm_files::{link_out_of, open_beneath};

use crate::error::{Refusal, UiError};

/// The paths that are shown, and the folder that is recorded into.
pub(crate) struct Roots {
    shown: Vec<PathBuf>,
    save: Option<PathBuf>,
    /// What was found at a path, until its size or time changes: lists are asked for every few seconds.
    kinds: Mutex<HashMap<PathBuf, (Stamp, Option<Known>)>>,
}

type Stamp = (u64, Option<SystemTime>);
type Known = (Kind, Option<&'static str>);

/// Something to look at.
#[derive(Debug, Serialize)]
pub(crate) struct Found {
    /// What requests name it by: the number of its root, and the path below it.
    pub id: String,
    /// As the user wrote the path.
    pub name: String,
    pub kind: Kind,
    /// Of a dataset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<&'static str>,
    pub bytes: u64,
}

/// What is at a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Kind {
    Dataset,
    Manifest,
    Receipt,
    Sweep,
    Evaluation,
    Training,
    Job,
}

/// So deep are folders searched…
const MAX_DEPTH: usize = 5;
/// …and so many entries of them looked at: a folder of a million files must not hold the page up.
const MAX_ENTRIES: usize = 20_000;
/// Files of results above this size are no results.
pub(crate) const MAX_RESULT_BYTES: u64 = 64 << 20;

impl Roots {
    /// `shown` and `save` exist, or the error says which does not; `save` is made.
    pub(crate) fn new(shown: &[PathBuf], save: Option<&Path>) -> Result<Self, UiError> {
        let real = |path: &PathBuf| {
            fs::canonicalize(path).map_err(|source| UiError::Path { path: path.clone(), source })
        };
        let shown = shown.iter().map(real).collect::<Result<_, _>>()?;
        let make = |path: &Path| {
            let made = fs::create_dir_all(path).and_then(|()| fs::canonicalize(path));
            made.map_err(|source| UiError::Save { path: path.to_owned(), source })
        };
        Ok(Self { shown, save: save.map(make).transpose()?, kinds: Mutex::default() })
    }

    fn all(&self) -> impl Iterator<Item = &PathBuf> {
        self.shown.iter().chain(&self.save)
    }

    /// The file or folder that an id stands for.
    ///
    /// # Errors
    ///
    /// It is not below a root, or not there.
    pub(crate) fn resolve(&self, id: &str) -> Result<PathBuf, Refusal> {
        let outside =
            || Refusal::forbidden(format!("`{id}` is outside of the paths that `swm ui` was given"));
        let (root, rest) = id.split_once('/').unwrap_or((id, ""));
        let root = root.parse::<usize>().ok().and_then(|root| self.all().nth(root)).ok_or_else(outside)?;
        let below = Path::new(rest);
        if !below.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(outside());
        }
        let path = if rest.is_empty() { root.clone() } else { root.join(below) };
        // Links are followed, and what they lead to must lie below a root, too.
        let real = fs::canonicalize(&path).map_err(|error| Refusal::bad(format!("`{id}`: {error}")))?;
        if self.holds(&real) { Ok(real) } else { Err(outside()) }
    }

    /// Opens the regular file at a path that [`Roots::resolve`] gave, or that was found in a folder of it.
    ///
    /// # Errors
    ///
    /// It is outside of the roots by now, no regular file, or cannot be read.
    pub(crate) fn open(&self, path: &Path) -> Result<fs::File, Refusal> {
        let outside = || {
            Refusal::forbidden(format!("{} is outside of the paths that `swm ui` was given", path.display()))
        };
        let root = self.all().find(|root| path.starts_with(root)).ok_or_else(outside)?;
        // A root may be a file.
        let (folder, below) = match path.strip_prefix(root) {
            Ok(below) if !below.as_os_str().is_empty() => (root.as_path(), below),
            _ => (root.parent().ok_or_else(outside)?, root.file_name().map(Path::new).ok_or_else(outside)?),
        };
        open_beneath(folder, below).map_err(|error| match error.kind() {
            ErrorKind::PermissionDenied => Refusal::forbidden(format!("{}: {error}", path.display())),
            _ => Refusal::bad(format!("{}: {error}", path.display())),
        })
    }

    /// Refuses a folder with links out of the roots: what reads a dataset or a model would follow them.
    ///
    /// # Errors
    ///
    /// Such a link.
    pub(crate) fn check_links(&self, path: &Path) -> Result<(), Refusal> {
        if !path.is_dir() {
            return Ok(());
        }
        match link_out_of(path, &|real| self.holds(real))? {
            None => Ok(()),
            Some(link) => Err(Refusal::forbidden(format!(
                "{} is a link out of the paths that `swm ui` was given; give what it leads to as well, or copy the folder without links",
                link.display()
            ))),
        }
    }

    /// The folder of a job. Links within are refused, and what is no file: what reads its files would follow them, or wait.
    ///
    /// # Errors
    ///
    /// As [`Roots::resolve`]; such a file.
    pub(crate) fn resolve_job(&self, id: &str) -> Result<PathBuf, Refusal> {
        let dir = self.resolve(id)?;
        let folders = ["done", "logs", "parts", "runs"].map(|name| dir.join(name));
        for folder in std::iter::once(dir.clone()).chain(folders) {
            let Ok(entries) = fs::read_dir(&folder) else { continue };
            for entry in entries {
                let entry = entry?;
                let kind = entry.file_type()?;
                if !kind.is_symlink() && !kind.is_file() && !kind.is_dir() {
                    return Err(Refusal::bad(format!("{} is no regular file", entry.path().display())));
                }
                if kind.is_symlink() {
                    let name = entry.path();
                    return Err(Refusal::forbidden(format!(
                        "{} is a link, which is not followed within jobs",
                        name.display()
                    )));
                }
            }
        }
        Ok(dir)
    }

    /// Whether a path, links resolved, is below a root.
    fn holds(&self, real: &Path) -> bool {
        self.all().any(|root| real.starts_with(root))
    }

    /// Refuses a file or folder elsewhere, whatever leads to it.
    ///
    /// # Errors
    ///
    /// It is outside of the roots, or not there.
    pub(crate) fn check_path(&self, path: &Path) -> Result<(), Refusal> {
        let real =
            fs::canonicalize(path).map_err(|error| Refusal::bad(format!("{}: {error}", path.display())))?;
        self.check_real(Some(&real), path)
    }

    /// Refuses arguments of policies and environments that name files elsewhere.
    ///
    /// # Errors
    ///
    /// Such an argument.
    pub(crate) fn check_text(&self, text: &str) -> Result<(), Refusal> {
        let path = Path::new(text);
        let is_path = text.contains(['/', '\\']) || text.starts_with('@') || path.exists();
        if is_path { self.check_real(fs::canonicalize(path).ok().as_deref(), path) } else { Ok(()) }
    }

    /// Refuses a path, links resolved, that is outside of the roots or leads out of them; `named` is how the user wrote it.
    fn check_real(&self, real: Option<&Path>, named: &Path) -> Result<(), Refusal> {
        match real {
            Some(real) if self.holds(real) => self.check_links(real),
            _ => Err(Refusal::forbidden(format!(
                "`{}` is outside of the paths that `swm ui` was given; give that path to `swm ui` as well",
                named.display()
            ))),
        }
    }

    /// As [`Roots::check_text`], for every text of a policy's arguments.
    pub(crate) fn check_policy(&self, args: &PolicyArgs) -> Result<(), Refusal> {
        args.named.values().chain(&args.positional).try_for_each(|value| self.check_json(value))
    }

    /// As [`Roots::check_text`], for every text within a setting.
    pub(crate) fn check_json(&self, value: &Json) -> Result<(), Refusal> {
        match value {
            Json::String(text) => self.check_text(text),
            Json::Array(items) => items.iter().try_for_each(|item| self.check_json(item)),
            Json::Object(map) => map.values().try_for_each(|item| self.check_json(item)),
            _ => Ok(()),
        }
    }

    /// The file of this name in the folder for recordings.
    ///
    /// # Errors
    ///
    /// There is no such folder; the name is no plain file name; what is there is a link.
    pub(crate) fn writable(&self, name: &str) -> Result<PathBuf, Refusal> {
        let Some(save) = &self.save else {
            return Err(Refusal::forbidden(
                "nothing is written: start `swm ui` with a folder for recordings, `save`",
            ));
        };
        let is_plain = !name.is_empty()
            && name.len() <= 128
            && !name.starts_with('.')
            && name.chars().all(|c| c.is_alphanumeric() || "._- ".contains(c));
        if !is_plain {
            return Err(Refusal::bad(format!(
                "`{name}` is no file name; use letters, digits, `.`, `_` and `-`"
            )));
        }
        let path = save.join(name);
        match fs::symlink_metadata(&path) {
            Ok(there) if there.is_symlink() => {
                Err(Refusal::forbidden(format!("`{name}` is a link, which is not followed")))
            }
            _ => Ok(path),
        }
    }

    /// The id of a file in the folder for recordings.
    pub(crate) fn saved_id(&self, name: &str) -> String {
        format!("{}/{name}", self.shown.len())
    }

    /// The folder for recordings, as a name for people.
    pub(crate) fn save_folder(&self) -> Option<String> {
        self.save.as_ref().map(|path| path.display().to_string())
    }

    /// Everything below the roots that there is a view for, by name.
    pub(crate) fn list(&self, registry: &Registry) -> Vec<Found> {
        let (mut found, mut left) = (Vec::new(), MAX_ENTRIES);
        for (index, root) in self.all().enumerate() {
            let is_covered = self.all().take(index).any(|other| root.starts_with(other));
            if !is_covered {
                self.walk(registry, root, &index.to_string(), MAX_DEPTH, &mut left, &mut found);
            }
        }
        found.sort_by(|a, b| a.name.cmp(&b.name));
        found
    }

    fn walk(
        &self,
        registry: &Registry,
        path: &Path,
        id: &str,
        depth: usize,
        left: &mut usize,
        found: &mut Vec<Found>,
    ) {
        if *left == 0 || !self.resolve(id).is_ok_and(|real| real == path) {
            return;
        }
        *left -= 1;
        let Ok(there) = fs::metadata(path) else { return };
        let bytes = there.len();
        if let Some((kind, format)) = self.known_kind(registry, path, (bytes, there.modified().ok())) {
            found.push(Found { id: id.to_owned(), name: path.display().to_string(), kind, format, bytes });
            // Within a job are its shards and its result.
            if kind != Kind::Job {
                return;
            }
        }
        let entries = fs::read_dir(path).ok().filter(|_| depth > 0);
        for entry in entries.into_iter().flatten().flatten() {
            let name = entry.file_name();
            let Some(name) = name.to_str().filter(|name| !name.starts_with('.')) else { continue };
            self.walk(registry, &entry.path(), &format!("{id}/{name}"), depth - 1, left, found);
        }
    }

    fn known_kind(&self, registry: &Registry, path: &Path, stamp: Stamp) -> Option<Known> {
        let kinds = || self.kinds.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, kind)) = kinds().get(path)
            && *known == stamp
        {
            return *kind;
        }
        let kind = self.kind_of(registry, path);
        kinds().insert(path.to_owned(), (stamp, kind));
        kind
    }

    /// What there is a view for at a path.
    pub(crate) fn kind_of(&self, registry: &Registry, path: &Path) -> Option<Known> {
        if path.is_dir() {
            if path.join("metrics.jsonl").is_file() {
                return Some((Kind::Training, None));
            }
            if path.join("job.json").is_file() {
                return Some((Kind::Job, None));
            }
            return dataset_at(registry, path);
        }
        let extension = path.extension()?.to_str()?;
        match extension {
            "json" | "toml" => Some((result_kind(&self.read_result(path).ok()?)?, None)),
            "jsonl" | "md" | "txt" | "png" | "gif" | "html" | "svg" | "lock" | "safetensors" => None,
            _ => dataset_at(registry, path),
        }
    }

    /// A file of results: JSON, or TOML by its extension.
    pub(crate) fn read_result(&self, path: &Path) -> Result<Json, Refusal> {
        let file = self.open(path)?;
        let bytes = file.metadata()?.len();
        if bytes > MAX_RESULT_BYTES {
            let limit = MAX_RESULT_BYTES >> 20;
            return Err(Refusal::bad(format!(
                "{} has {} MB, results have up to {limit}",
                path.display(),
                bytes >> 20
            )));
        }
        let mut text = String::new();
        file.take(MAX_RESULT_BYTES).read_to_string(&mut text)?;
        match path.extension().is_some_and(|extension| extension == "toml") {
            true => Ok(toml::from_str(&text)?),
            false => Ok(serde_json::from_str(&text)?),
        }
    }
}

fn result_kind(json: &Json) -> Option<Kind> {
    let has = |key: &str| json.get(key).is_some();
    match () {
        () if has("receipt") && has("episodes") => Some(Kind::Receipt),
        () if has("sweep") && has("cells") => Some(Kind::Sweep),
        () if has("pairs") && has("budget") => Some(Kind::Manifest),
        () if has("success_rate") && has("episodes") => Some(Kind::Evaluation),
        () => None,
    }
}

/// A dataset of a format of this program, or of another program.
fn dataset_at(registry: &Registry, path: &Path) -> Option<Known> {
    match swm_data::format::detect(registry, path) {
        Some(format) => Some((Kind::Dataset, Some(format.name))),
        None if swm_data::format::is_of_other_program(registry, path) => {
            Some((Kind::Dataset, Some("of another program")))
        }
        None => None,
    }
}
