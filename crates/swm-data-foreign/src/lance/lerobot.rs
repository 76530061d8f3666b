//! LeRobot datasets in the storage of Lance: the rows are in `frames.lance`, with names without dots, and `meta/info.json` has the features.
//!
//! Source of the layout: lerobot 0.6.1 with lerobot-lancedb 0.3.1.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_data::foreign::{LEROBOT_NAMES, is_lerobot_in_lance};

use crate::found::Found;

const FRAMES: &str = "frames.lance";

/// The folder of its rows.
pub(super) fn frames(path: &Path) -> Option<PathBuf> {
    is_lerobot_in_lance(path).then(|| path.join(FRAMES))
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
        let new = LEROBOT_NAMES.iter().find(|(old, new)| old == feature && !features.contains_key(*new));
        source.old.clone_from(feature);
        source.new = new.map_or(feature.as_str(), |(_, new)| new).to_owned();
    }
}
