//! `meta/info.json`: which columns there are, and where files lie.

use std::fs;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value as Json, json};
use swm_core::Field;
use swm_data::error::{At as _, DataError, Result, invalid, missing, unsupported};
use swm_data::foreign;
use swm_data::recording::replace_json;
use swm_files::read_regular;

use super::episodes::CHUNK;
use super::manifest::{Manifest, OWN, is_own, is_video};

/// Where it lies.
pub(super) const INFO: &str = "meta/info.json";
/// Above this size it is taken for damage.
const MAX_BYTES: u64 = 64 << 20;

/// What it says, as far as it is used here.
#[derive(Debug, Deserialize)]
pub(super) struct Info {
    codebase_version: String,
    pub(super) fps: f64,
    pub(super) total_episodes: usize,
    /// Whole numbers, where a program wrote them.
    #[serde(default)]
    pub(super) total_frames: Json,
    #[serde(default)]
    pub(super) total_tasks: Json,
    #[serde(default = "usual_chunk")]
    pub(super) chunks_size: usize,
    /// Of `lance`, there are no tables and videos.
    storage_format: Option<String>,
    #[serde(default)]
    data_path: String,
    video_path: Option<String>,
    /// By name: what a column is.
    pub(super) features: Map<String, Json>,
}

fn usual_chunk() -> usize {
    1000
}

/// The two layouts: a file per episode, or several episodes in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Version {
    V2,
    V3,
}

impl Info {
    pub(super) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(INFO);
        let length = fs::metadata(&path)?.len();
        if length > MAX_BYTES {
            return Err(invalid(format!("`{INFO}` has {length} bytes")));
        }
        let bytes = read_regular(&path)?;
        let info: Self = serde_json::from_slice(&bytes).at(format_args!("`{INFO}`"))?;
        info.version()?;
        if info.storage_format.as_deref() == Some("lance") {
            return Err(unsupported(format!(
                "it is a LeRobot dataset in Lance's storage (`storage_format` of `{INFO}`), which is not read yet; read it with LeRobot \
                 in Python, and {}",
                foreign::BRING
            )));
        }
        match info.fps.is_finite() && info.fps > 0.0 && info.chunks_size > 0 {
            true => Ok(info),
            false => Err(invalid(format!(
                "`{INFO}`: {} frames per second, {} episodes per chunk",
                info.fps, info.chunks_size
            ))),
        }
    }

    pub(super) fn version(&self) -> Result<Version> {
        match self.codebase_version.as_str() {
            version if version.starts_with("v2.") => Ok(Version::V2),
            version if version.starts_with("v3.") => Ok(Version::V3),
            other => Err(unsupported(format!("its version is `{other}`; v2.1 and v3.0 are read"))),
        }
    }

    /// The table of an episode.
    pub(super) fn data(&self, folder: &Path, numbers: &[(&str, usize)]) -> Result<PathBuf> {
        inside(folder, &filled(&self.data_path, numbers, ""))
    }

    /// The video of a camera.
    pub(super) fn video(&self, folder: &Path, camera: &str, numbers: &[(&str, usize)]) -> Result<PathBuf> {
        let path = self.video_path.as_deref().ok_or(missing("it names no place for its videos"))?;
        inside(folder, &filled(path, numbers, camera))
    }
}

/// The description of a folder of ours for LeRobot.
#[derive(Serialize)]
struct InfoOut {
    codebase_version: &'static str,
    robot_type: String,
    total_episodes: usize,
    total_frames: usize,
    total_tasks: usize,
    chunks_size: usize,
    data_files_size_in_mb: usize,
    video_files_size_in_mb: usize,
    fps: Json,
    splits: Json,
    data_path: &'static str,
    video_path: &'static str,
    features: Ordered,
}

/// An object whose keys keep their order: the first camera is the one that readers take for `pixels`.
struct Ordered(Vec<(String, Json)>);

impl Serialize for Ordered {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, value)| (key, value)))
    }
}

/// Writes it for a folder of ours.
pub(super) fn write(
    folder: &Path,
    manifest: &Manifest,
    episodes: usize,
    rows: usize,
    tasks: usize,
) -> Result<(), DataError> {
    let rate = manifest.frames_per_second;
    let whole = rate.fract() == 0.0 && rate < 1e9;
    let info = InfoOut {
        codebase_version: "v3.0",
        robot_type: super::episodes::env(manifest).to_owned(),
        total_episodes: episodes,
        total_frames: rows,
        total_tasks: tasks,
        chunks_size: CHUNK,
        data_files_size_in_mb: 100,
        video_files_size_in_mb: 200,
        // LeRobot expects a whole number.
        fps: if whole { json!(rate as u64) } else { json!(rate) },
        splits: json!({"train": format!("0:{episodes}")}),
        data_path: "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        video_path: "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        features: Ordered(features(manifest)),
    };
    replace_json(&folder.join(INFO), &info)
}

/// The features of a folder of ours.
pub(super) fn features(manifest: &Manifest) -> Vec<(String, Json)> {
    let mut features = Vec::new();
    let stored = |field: &&Field| !is_own(&field.name) && !manifest.is_task(&field.name);
    for field in manifest.columns.iter().filter(stored) {
        let value = if is_video(field) {
            json!({
                "dtype": "video",
                "shape": field.shape,
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": field.shape[0],
                    "video.width": field.shape[1],
                    "video.channels": 3,
                    "video.codec": "h264",
                    "video.pix_fmt": "yuv420p",
                    "video.is_depth_map": false,
                    "video.fps": manifest.frames_per_second,
                    "has_audio": false,
                },
            })
        } else {
            // Rows of more than one dimension are stored flat: every reader has lists.
            json!({"dtype": field.dtype.name(), "shape": [field.dim()], "names": null})
        };
        features.push((manifest.feature(&field.name), value));
    }
    // The camera that readers shall take first.
    features.sort_by_key(|(name, _)| !name.ends_with(".pixels"));
    for (name, dtype) in OWN {
        features.push((name.to_owned(), json!({"dtype": dtype.name(), "shape": [1], "names": null})));
    }
    features
}

/// `chunk-{chunk_index:03d}` with its numbers.
fn filled(pattern: &str, numbers: &[(&str, usize)], camera: &str) -> String {
    let mut path = pattern.replace("{video_key}", camera);
    for (name, number) in numbers {
        for (format, text) in [
            (format!("{{{name}:03d}}"), format!("{number:03}")),
            (format!("{{{name}:06d}}"), format!("{number:06}")),
            (format!("{{{name}}}"), number.to_string()),
        ] {
            path = path.replace(&format, &text);
        }
    }
    path
}

/// A path below the folder; anything else is refused.
fn inside(folder: &Path, path: &str) -> Result<PathBuf> {
    let relative = Path::new(path);
    let stays = relative.components().all(|part| matches!(part, Component::Normal(_)));
    match stays && !path.contains(['\0', '\\', '{']) {
        true => Ok(folder.join(relative)),
        false => Err(invalid(format!("`{INFO}` names the file `{path}`, which is none inside the folder"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_filled_and_stay_inside() {
        let numbers = [("chunk_index", 2), ("file_index", 17)];
        let path =
            filled("videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4", &numbers, "top");
        assert_eq!(path, "videos/top/chunk-002/file-017.mp4");
        assert!(inside(Path::new("a"), &path).is_ok());
        for path in ["../x", "/etc/passwd", "a/../../b", "a/{unknown}", "c:\\x"] {
            assert!(inside(Path::new("a"), path).is_err(), "{path}");
        }
    }
}
