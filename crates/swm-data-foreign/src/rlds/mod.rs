//! RLDS: datasets of episodes that TensorFlow Datasets writes as files of TFRecord, such as those of Open X-Embodiment.
//!
//! Source of the layout: tensorflow-datasets 4.9.10, `core/example_serializer.py`, `core/naming.py`; a record is an episode, and the values
//! of a key are those of all of its steps, one behind the other.

mod column;
mod example;
mod features;
mod records;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use column::{Episodes, Values};
use features::{Feature, Kind, leaves};
use serde_json::Value as Json;
use swm_core::FieldKind;
use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{At as _, DataError, Result, invalid, missing, unsupported};
use swm_files::{is_plain_name, read_regular};

use super::array::{Scratch, Shared};
use super::dataset::Span;
use super::found::{Found, Source};

const NAME: &str = "rlds";
const INFO: &str = "dataset_info.json";
const FEATURES: &str = "features.json";
/// What keys of steps begin with.
const STEPS: &str = "steps/";
/// Shards of a part, at most.
const MAX_SHARDS: usize = 100_000;

/// The folders of the files: that of the dataset, or those of its versions.
fn folders(path: &Path) -> Vec<PathBuf> {
    let is_it = |folder: &Path| folder.join(INFO).is_file() && folder.join(FEATURES).is_file();
    if is_it(path) {
        return vec![path.to_owned()];
    }
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().take(1000);
    let mut versions: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|folder| is_it(folder)).collect();
    versions.sort();
    versions
}

pub(super) fn detect(path: &Path) -> bool {
    path.is_dir()
        && folders(path).first().is_some_and(|folder| {
            let features = json(folder, FEATURES).unwrap_or_default();
            features["featuresDict"]["features"]["steps"]["sequence"].is_object()
        })
}

/// The only folder of a dataset.
fn folder(path: &Path) -> Result<PathBuf> {
    let mut folders = folders(path);
    if let [_, _, ..] = folders[..] {
        let names = folders.iter().filter_map(|folder| folder.file_name()?.to_str());
        return Err(unsupported(format!(
            "it has several versions, {}; open the folder of one of them",
            names.collect::<Vec<_>>().join(", ")
        )));
    }
    folders.pop().ok_or_else(|| missing(format!("`{INFO}` is missing")))
}

fn json(folder: &Path, name: &str) -> Result<Json> {
    let text = read_regular(&folder.join(name)).at(name)?;
    serde_json::from_slice(&text).at(name)
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let damaged = |error| DataError::damaged(path, error);
    let folder = folder(path).map_err(damaged)?;
    let info = json(&folder, INFO).map_err(damaged)?;
    let (part, note) = part(&info, options.split.as_deref())?;
    let features = json(&folder, FEATURES).map_err(damaged)?;
    let mut found = find(&folder, &info, part, &leaves(&features)).map_err(damaged)?;
    found.notes.extend(note);
    if options.fps.is_none() {
        found.notes.push("it does not say its rate; the option `fps` does".to_owned());
    }
    found.open(path, NAME, options, &["split"])
}

/// A part of the dataset, and a note about the others.
fn part<'a>(info: &'a Json, wanted: Option<&str>) -> Result<(&'a Json, Option<String>), DataError> {
    let parts: &'a [Json] = info["splits"].as_array().map_or(&[], Vec::as_slice);
    let name = |part: &'a Json| part["name"].as_str().unwrap_or_default();
    let names = parts.iter().map(name).collect::<Vec<_>>().join(", ");
    let refuse = |reason| Err(DataError::Option { option: "split", reason });
    let find = |wanted: &str| parts.iter().find(|part| name(part) == wanted);
    match wanted {
        Some(wanted) => match find(wanted) {
            Some(part) => Ok((part, None)),
            None => refuse(format!("there is no part `{wanted}`; there are {names}")),
        },
        None => match find("train").or(parts.first()) {
            Some(part) if parts.len() == 1 => Ok((part, None)),
            Some(part) => {
                let note =
                    format!("this is the part `{}` of {names}; the option `split` names another", name(part));
                Ok((part, Some(note)))
            }
            None => refuse(format!("`{INFO}` names no parts")),
        },
    }
}

/// The files of a part.
fn shards(info: &Json, part: &Json) -> Result<Vec<(String, Option<usize>)>> {
    let kind = part["fileFormat"].as_str().or(info["fileFormat"].as_str()).unwrap_or("tfrecord");
    if kind != "tfrecord" {
        return Err(unsupported(format!(
            "its files are of the format {kind}, and tfrecord is read; write it again with `tfds convert_format --out_file_format=tfrecord`"
        )));
    }
    let none = Vec::new();
    let lengths = part["shardLengths"].as_array().unwrap_or(&none);
    if lengths.len() > MAX_SHARDS {
        return Err(invalid(format!("`{INFO}` names {} files", lengths.len())));
    }
    let template = part["filepathTemplate"].as_str().filter(|template| !template.is_empty());
    let template = template.unwrap_or("{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}");
    let (set, name) = (info["name"].as_str().unwrap_or_default(), part["name"].as_str().unwrap_or_default());
    let count = lengths.len();
    let of = |(index, length): (usize, &Json)| {
        let file = template
            .replace("{DATASET}", set)
            .replace("{SPLIT}", name)
            .replace("{FILEFORMAT}", kind)
            .replace("{SHARD_X_OF_Y}", &format!("{index:05}-of-{count:05}"))
            .replace("{SHARD_INDEX}", &format!("{index:05}"))
            .replace("{NUM_SHARDS}", &format!("{count:05}"));
        let length = length
            .as_u64()
            .or_else(|| length.as_str()?.parse().ok())
            .and_then(|length| usize::try_from(length).ok());
        match is_plain_name(&file) {
            true => Ok((file, length)),
            false => Err(invalid(format!("`{INFO}` names the file `{}`", file.escape_debug()))),
        }
    };
    lengths.iter().enumerate().map(of).collect()
}

fn find(folder: &Path, info: &Json, part: &Json, features: &[Feature]) -> Result<Found> {
    let mut records = Vec::new();
    for (file, length) in shards(info, part)? {
        let found = records::records(&folder.join(&file))?;
        if length.is_some_and(|length| length != found.len()) {
            let length = length.unwrap_or_default();
            return Err(invalid(format!("`{file}` has {} episodes, by `{INFO}` {length}", found.len())));
        }
        records.extend(found);
    }
    let episodes = Arc::new(Episodes::new(records, features)?);
    let mut found = Found { lengths: episodes.lengths().to_vec(), ..Found::default() };
    let whole = found.end_to_end();
    let mut scratch = Scratch::default();
    for feature in features {
        let (path, kind) = match feature.key.strip_prefix(STEPS) {
            Some(path) => (path, FieldKind::Step),
            None => (feature.key.as_str(), FieldKind::Episode),
        };
        let new = name_of(path, kind);
        if let Kind::Skipped(reason) = &feature.kind {
            found.skipped.push((new, reason.clone()));
            continue;
        }
        let has: Vec<bool> = (0..whole.len()).map(|episode| episodes.has(episode, &feature.key)).collect();
        if !has.is_empty() && !has.contains(&true) {
            found.skipped.push((new, "no record has values of it".to_owned()));
            continue;
        }
        match Values::new(&episodes, feature, kind, &mut scratch)? {
            Ok(values) => {
                let arrays: Vec<Shared> = vec![Arc::new(values)];
                found.note_absent(&feature.key, &has);
                let span = |(&span, &has): (&Span, &bool)| if has { span } else { Span::NONE };
                let spans = whole.iter().zip(&has).map(span).collect();
                found.sources.push(Source { old: feature.key.clone(), new, kind, arrays, spans });
            }
            Err(reason) => found.skipped.push((new, reason)),
        }
    }
    if found.sources.iter().any(|source| source.new == "truncated") {
        found.notes.push("`is_last` is `truncated` where `is_terminal` is not set".to_owned());
    }
    found.notes.push(
        "its episodes are in the order of their files, which is not that of recording; by RLDS, the action of a last step means nothing, \
         and many datasets have a real one there: it is kept"
            .to_owned(),
    );
    Ok(found)
}

fn name_of(path: &str, kind: FieldKind) -> String {
    match (path, kind) {
        ("is_terminal", FieldKind::Step) => "terminated".to_owned(),
        ("is_last", FieldKind::Step) => "truncated".to_owned(),
        ("observation/state", FieldKind::Step) => "proprio".to_owned(),
        _ => path.replace('/', "."),
    }
}
