//! Manifests and receipts on disk.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::dataset::Dataset;
use swm_core::evaluate::RecordedPairs;
use swm_core::settings::{WrongSetting, read as read_settings};
use swm_core::{EnvEntry, Manifest, Registry};
use swm_data::rendered::env_named;

use super::hash::file_hash;
use super::receipt::{RECEIPT_VERSION, Receipt};
use super::relative;
use crate::error::cannot;
use crate::request::{Assignment, Fix, Message, TaskError};
use crate::text_file::{json_error, read_text, replace_text, toml_error};

/// The key of [`Sealed::hash`].
const SEAL: &str = "hash";

/// Pairs of the dataset at `path`, opened as `source`: its name, its hash, and the rest as [`RecordedPairs::new`] has it.
///
/// # Errors
///
/// The file cannot be read.
pub fn recorded_pairs<'a>(source: &'a mut dyn Dataset, path: &Path) -> Result<RecordedPairs<'a>, TaskError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(RecordedPairs::new(source, name, file_hash(path)?))
}

/// Reads a manifest: JSON if the name ends so, else TOML. One that was changed after it was written is refused, unless the
/// line with its hash was taken out.
///
/// # Errors
///
/// The file cannot be read, is no manifest of a known version, fails [`Manifest::check`], or was changed.
pub fn read_manifest(path: &Path) -> Result<Manifest, TaskError> {
    let text = read_text(path).map_err(cannot("read the manifest", path))?;
    let wrong = |reason: String| format!("manifest {}: {reason}", path.display());
    let parsed = if is_json(path) { from_json(&text) } else { from_toml(&text) };
    let (seal, manifest) = parsed.map_err(|error| wrong(error.to_string()))?;
    manifest.check().map_err(|error| wrong(error.to_string()))?;
    let hash = manifest.hash();
    if seal.is_some_and(|seal| seal != hash) {
        let reason =
            "was changed after it was written, and is another task now: its hash differs from the one in it";
        let fix =
            format!("if that is intended, remove the line `{SEAL} = …` from it; otherwise make it again");
        return Err(wrong(format!("{reason}; {fix}")).into());
    }
    Ok(manifest)
}

/// The environment of a task.
///
/// # Errors
///
/// This program does not have it.
pub fn env_of(registry: &Registry, manifest: &Manifest) -> Result<&'static EnvEntry, TaskError> {
    Ok(env_named(registry, &manifest.env, "the task is in")?)
}

/// Writes a manifest with its hash: JSON if the name ends so, else TOML. An existing file is replaced.
///
/// # Errors
///
/// What [`read_manifest`] would refuse, a value that TOML does not have, or the file cannot be written.
pub fn write_manifest(path: &Path, manifest: &Manifest) -> Result<(), TaskError> {
    manifest.check()?;
    let text = match is_json(path) {
        true => serde_json::to_string_pretty(&Sealed::from(manifest))? + "\n",
        false => to_toml(manifest)?,
    };
    Ok(replace_text(path, &text).map_err(cannot("write", path))?)
}

/// Whether the file at `path` is this manifest already. A file that is anything else is not to be replaced unless that is
/// asked for: results refer to it.
///
/// # Errors
///
/// The file is another manifest, or none; or its name is that of YAML, which no manifest is.
pub fn holds_manifest(path: &Path, manifest: &Manifest) -> Result<bool, TaskError> {
    let out = path.display();
    if path.extension().is_some_and(|extension| extension == "yaml" || extension == "yml") {
        return Err(Message::new(format!("{out}: a manifest is TOML or JSON; name it .toml or .json")).into());
    }
    if !path.exists() {
        return Ok(false);
    }
    let holds = match read_manifest(path) {
        Ok(held) if held.hash() == manifest.hash() => return Ok(true),
        Ok(held) => format!("{out} holds another manifest ({}, {} pairs)", held.env, held.pairs.len()),
        Err(_) => format!("{out} exists and is no manifest"),
    };
    let replace = Fix::Set { setting: Assignment::of("overwrite", true), to: "to replace it" };
    Err(Message::new(holds).fix(Fix::Any(vec![Fix::Change("out"), replace])).into())
}

/// Reads a receipt, from its file or the folder that it lies in.
///
/// # Errors
///
/// The file cannot be read, or is no receipt of a known version.
pub fn read_receipt(path: &Path) -> Result<Receipt, TaskError> {
    let is_folder = path.is_dir();
    if is_folder && !path.join("receipt.json").exists() {
        let (folder, below) = (path.display(), results_below(path));
        let advice = if path.join("sweep.json").exists() {
            format!("it is the result of a sweep, which `swm report {folder}` shows")
        } else if below.is_empty() {
            "an evaluation on a manifest writes one".to_owned()
        } else {
            format!("but these do: {}", below.join(", "))
        };
        return Err(format!("{folder} holds no receipt: {advice}").into());
    }
    let path = if is_folder { path.join("receipt.json") } else { path.to_owned() };
    let text = read_text(&path).map_err(cannot("read the receipt", &path))?;
    let wrong = |reason: String| format!("receipt {}: {reason}", path.display());
    let no_json = |error: serde_json::Error| {
        let reason = json_error(&text, &error);
        wrong(format!("is no receipt, which is JSON that an evaluation on a manifest writes: {reason}"))
    };
    let json: Json = serde_json::from_str(&text).map_err(no_json)?;
    match json.get("receipt").and_then(Json::as_u64) {
        Some(version) if (1..=u64::from(RECEIPT_VERSION)).contains(&version) => {}
        Some(version) => {
            let reason = format!("has version {version}, this program reads 1 to {RECEIPT_VERSION}");
            return Err(wrong(reason).into());
        }
        None => {
            return Err(wrong("is no receipt; an evaluation on a manifest writes one".to_owned()).into());
        }
    }
    // Its version is one of its keys, so it is an object.
    let object = json.as_object().cloned().unwrap_or_default();
    let damaged = |WrongSetting { name, reason }| {
        wrong(format!("`{name}`: {reason}; it was edited or damaged; evaluate again"))
    };
    let mut receipt: Receipt = read_settings(&object).map_err(damaged)?;
    relative::resolve(&mut receipt, path.parent().unwrap_or(Path::new(""))).map_err(wrong)?;
    Ok(receipt)
}

/// Folders right below `dir` that hold receipts.
fn results_below(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<String> = entries
        .filter(|path| path.join("receipt.json").exists())
        .map(|path| path.display().to_string())
        .collect();
    found.sort();
    found
}

/// Writes a receipt into the folder `dir`, and returns its path. An existing one is replaced.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_receipt(dir: &Path, receipt: &Receipt) -> Result<PathBuf, TaskError> {
    let path = dir.join("receipt.json");
    let text = serde_json::to_string_pretty(receipt)? + "\n";
    replace_text(&path, &text).map_err(cannot("write", &path))?;
    Ok(path)
}

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "json")
}

/// A manifest's file: the hash first, then the content.
#[derive(Serialize)]
struct Sealed<'a> {
    hash: String,
    #[serde(flatten)]
    manifest: &'a Manifest,
}

impl<'a> From<&'a Manifest> for Sealed<'a> {
    fn from(manifest: &'a Manifest) -> Self {
        Self { hash: manifest.hash(), manifest }
    }
}

/// Why a text is no manifest at all.
fn no_manifest(reason: &str) -> String {
    format!("is no manifest, which is TOML, or JSON if its name ends in .json: {reason}")
}

/// What a file says its hash is, and the rest of it.
type Parsed = (Option<String>, Manifest);

fn from_json(text: &str) -> Result<Parsed, TaskError> {
    let mut json: Map<String, Json> =
        serde_json::from_str(text).map_err(|error| no_manifest(&json_error(text, &error)))?;
    let seal = json.remove(SEAL).map(serde_json::from_value).transpose()?;
    Ok((seal, read_settings(&json).map_err(|error| format!("`{}`: {}", error.name, error.reason))?))
}

fn from_toml(text: &str) -> Result<Parsed, TaskError> {
    let mut table: toml::Table =
        toml::from_str(text).map_err(|error| no_manifest(&toml_error(text, &error)))?;
    let seal = table.remove(SEAL).map(toml::Value::try_into).transpose()?;
    Ok((seal, table.try_into().map_err(|error| toml_error(text, &error))?))
}

fn to_toml(manifest: &Manifest) -> Result<String, TaskError> {
    Ok(toml::to_string(&Sealed::from(manifest))?)
}
