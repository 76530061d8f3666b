//! LeRobot datasets in the storage of Lance: the rows are in `frames.lance`, with names without dots, and `meta/info.json` has the features.
//!
//! Source of the layout: lerobot 0.6.1 with lerobot-lancedb 0.3.1.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use super::super::found::Found;
use crate::formats::disk::open_regular;

const INFO: &str = "meta/info.json";
const FRAMES: &str = "frames.lance";
/// The description is never longer.
const MAX_BYTES: u64 = 16 << 20;

/// Features that get another name, where no other feature has it.
pub(crate) const NAMES: [(&str, &str); 5] = [
    ("observation.state", "proprio"),
    ("next.reward", "reward"),
    ("next.done", "terminated"),
    ("next.truncated", "truncated"),
    ("next.success", "success"),
];

/// Whether there is such a dataset.
pub(crate) fn is_native(path: &Path) -> bool {
    path.join(FRAMES).is_dir() && info(path).is_some()
}

/// The folder of its rows.
pub(super) fn frames(path: &Path) -> Option<PathBuf> {
    is_native(path).then(|| path.join(FRAMES))
}

/// Its description.
pub(super) fn info(path: &Path) -> Option<Json> {
    let path = path.join(INFO);
    if path.metadata().ok()?.len() > MAX_BYTES {
        return None;
    }
    let info: Json = serde_json::from_reader(open_regular(&path).ok()?).ok()?;
    (info["storage_format"] == "lance").then_some(info)
}

/// Gives columns the names of the features.
pub(super) fn name(info: &Json, found: &mut Found) {
    found.fps = info["fps"].as_f64().filter(|fps| fps.is_finite() && *fps > 0.0);
    let Some(features) = info["features"].as_object() else { return };
    for (feature, about) in features {
        if about["dtype"] == "video" {
            let reason = "its images are videos in blobs of `videos.lance`, which are not read; open the dataset that was converted into the storage of Lance, \
                          whose videos are files";
            found.skipped.push((feature.clone(), reason.to_owned()));
            continue;
        }
        let stored = feature.replace('.', "_");
        let Some(source) = found.sources.iter_mut().find(|source| source.old == stored) else { continue };
        let new = NAMES.iter().find(|(old, new)| old == feature && !features.contains_key(*new));
        source.old.clone_from(feature);
        source.new = new.map_or(feature.as_str(), |(_, new)| new).to_owned();
    }
}
