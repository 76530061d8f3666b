//! Datasets that a request names. One that is not there is a wrong request; one that is there and cannot be read is a failure
//! of the work.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::settings::read as read_settings;
use swm_core::{EnvEntry, ImageSize, Manifest, Metadata, Registry};
use swm_data::{DataError, Dataset, OpenOptions, RenderOptions, Rendered};
use swm_files::WriterLock;
use swm_files::remote::is_remote;
use swm_media::Format;

use super::{Fix, Message, TaskError, wrong};
use crate::evaluation::read_manifest;

/// Opens a dataset that the user named.
///
/// # Errors
///
/// Nothing is at the path ([`TaskError::Request`]), or it cannot be read.
pub fn open_dataset(registry: &Registry, path: &Path) -> Result<Box<dyn Dataset>, TaskError> {
    open_dataset_with(registry, path, &OpenOptions::default())
}

/// As [`open_dataset`], with options: what the files of another program do not hold, or hold in several forms.
///
/// # Errors
///
/// As of [`open_dataset`]; an option is wrong, or missing ([`TaskError::Request`]).
pub fn open_dataset_with(
    registry: &Registry,
    path: &Path,
    options: &OpenOptions,
) -> Result<Box<dyn Dataset>, TaskError> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound && !is_remote(path) => {
            Err(wrong(DataError::io(path, "open", error)))
        }
        // What else is in the way is found when it is opened.
        _ => swm_data::open_with(registry, path, options).map_err(|error| match error {
            error @ DataError::Option { .. } => wrong(error),
            // Nothing is at this address.
            DataError::Io { ref source, .. } if is_remote(path) && source.kind() == ErrorKind::NotFound => {
                wrong(error)
            }
            error => error.into(),
        }),
    }
}

/// Refuses options of opening a dataset where none is named.
///
/// # Errors
///
/// [`TaskError::Request`], which names the first of them.
pub fn check_opening(has_dataset: bool, options: &OpenOptions) -> Result<(), TaskError> {
    options.check().map_err(wrong)?;
    match options.given().first() {
        Some(&option) if !has_dataset => {
            let message = Message::about_setting(option, "is about a dataset, and none is named");
            Err(message.fix(Fix::Any(vec![Fix::give("dataset"), Fix::Leave(option)])).into())
        }
        _ => Ok(()),
    }
}

/// Refuses a dataset that was recorded in another environment than that of the request, or with another frame skip than the one
/// that was asked for. A dataset that does not say how it was recorded passes.
///
/// # Errors
///
/// [`TaskError::Request`], which names both.
pub fn check_recorded_in(
    dataset: &dyn Dataset,
    entry: &EnvEntry,
    frame_skip: Option<u32>,
) -> Result<(), TaskError> {
    let Some(recorded) = dataset.metadata().and_then(Metadata::of_known_env) else { return Ok(()) };
    let (path, env) = (dataset.path().display(), &recorded.env);
    if env != entry.id {
        let text = format!("the dataset {path} was recorded in {env}, not in {}", entry.id);
        let fixes = vec![Fix::Change("dataset"), Fix::set("env", env.as_str())];
        return Err(Message::new(text).fix(Fix::Any(fixes)).into());
    }
    match frame_skip.filter(|&wanted| wanted != recorded.frame_skip) {
        Some(wanted) => {
            let recorded = recorded.frame_skip;
            let text =
                format!("the dataset {path} was recorded with frame skip {recorded}, the default for it");
            Err(Message::about("frame_skip", wanted, text).fix(Fix::Leave("frame_skip")).into())
        }
        None => Ok(()),
    }
}

/// The dataset with images of this size, in place of those that it holds.
pub(super) fn rendered(
    dataset: Box<dyn Dataset>,
    registry: &Registry,
    size: ImageSize,
) -> Result<Box<dyn Dataset>, TaskError> {
    Ok(Box::new(Rendered::new(dataset, registry, &RenderOptions::default().image(size)).map_err(wrong)?))
}

/// Refuses to write to an address: datasets that lie elsewhere are read, not written.
fn check_here(path: &Path) -> Result<(), TaskError> {
    if !is_remote(path) {
        return Ok(());
    }
    let path = path.display();
    Err(wrong(format!(
        "{path} is an address, where datasets are read, not written; write here, and copy it there"
    )))
}

/// Makes a folder for results.
///
/// # Errors
///
/// It cannot be made.
pub fn make_folder(dir: &Path) -> Result<(), TaskError> {
    check_here(dir)?;
    let failed = |error| wrong(format!("cannot write to the folder {}: {error}", dir.display()));
    std::fs::create_dir_all(dir).map_err(failed)
}

/// Makes the folder that `path` will lie in.
///
/// # Errors
///
/// It cannot be made.
pub fn create_parent(path: &Path) -> Result<(), TaskError> {
    check_here(path)?;
    let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) else { return Ok(()) };
    std::fs::create_dir_all(parent)
        .map_err(|source| DataError::io(parent, "create the folder", source).into())
}

/// Keeps other processes from writing the file or folder `path`, which need not be there yet, until the lock is dropped.
pub(super) fn claim(path: &Path) -> Result<WriterLock, TaskError> {
    Ok(WriterLock::take(path)?)
}

/// The format of videos of this name; `None`: mp4 where this build can make it.
pub(super) fn video_format_of(name: Option<&str>) -> Result<Format, TaskError> {
    match name {
        Some("gif") => Ok(Format::Gif),
        Some("mp4") => Ok(Format::Mp4),
        None if Format::Mp4.is_built() => Ok(Format::Mp4),
        None => Ok(Format::Gif),
        Some(other) => {
            let message = Message::about("video_format", other, "no format of videos");
            Err(message.fix(Fix::Choose(vec!["mp4".to_owned(), "gif".to_owned()])).into())
        }
    }
}

/// Refuses a format of videos that this build cannot make.
pub(super) fn check_built(format: Format) -> Result<(), TaskError> {
    if format.is_built() {
        return Ok(());
    }
    let message =
        Message::about("video_format", "mp4", "this build is without the feature `mp4`, the encoder");
    Err(message.fix(Fix::set("video_format", "gif")).into())
}

/// A manifest: the path of its file, or its JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ManifestSource {
    /// Its file.
    File(PathBuf),
    /// The manifest itself.
    Json(Map<String, Json>),
}

impl ManifestSource {
    /// The manifest.
    ///
    /// # Errors
    ///
    /// The file cannot be read; or what is given is no manifest.
    pub fn read(&self) -> Result<Manifest, TaskError> {
        let refused = |reason: String| wrong(format!("the manifest: {reason}"));
        match self {
            Self::File(path) => read_manifest(path).map_err(wrong),
            Self::Json(json) => {
                let manifest: Manifest = read_settings(json).map_err(|error| refused(error.to_string()))?;
                manifest.check().map_err(|error| refused(error.to_string()))?;
                Ok(manifest)
            }
        }
    }
}
