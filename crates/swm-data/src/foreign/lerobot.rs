//! LeRobot datasets in the storage of Lance, which the format `lerobot` leaves to the layout that reads their tables.
//!
//! Source of the layout: lerobot 0.6.1 with lerobot-lancedb 0.3.1.

use std::path::Path;

use serde_json::Value as Json;

use swm_files::open_regular;

const INFO: &str = "meta/info.json";
const FRAMES: &str = "frames.lance";
/// The description is never longer.
const MAX_BYTES: u64 = 16 << 20;

/// Features of LeRobot that get another name, where no other feature has it.
pub const LEROBOT_NAMES: [(&str, &str); 5] = [
    ("observation.state", "proprio"),
    ("next.reward", "reward"),
    ("next.done", "terminated"),
    ("next.truncated", "truncated"),
    ("next.success", "success"),
];

/// Whether there is a LeRobot dataset in the storage of Lance, whose rows are in `frames.lance`.
#[must_use]
pub fn is_lerobot_in_lance(path: &Path) -> bool {
    path.join(FRAMES).is_dir() && lerobot_info(path).is_some()
}

/// The description of such a dataset, `meta/info.json`.
#[must_use]
pub fn lerobot_info(path: &Path) -> Option<Json> {
    let path = path.join(INFO);
    if path.metadata().ok()?.len() > MAX_BYTES {
        return None;
    }
    let info: Json = serde_json::from_reader(open_regular(&path).ok()?).ok()?;
    (info["storage_format"] == "lance").then_some(info)
}
