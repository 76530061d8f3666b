//! `meta/info.json`: which columns there are, and where files lie.

use std::fs;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value as Json};

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
    #[serde(default = "usual_chunk")]
    pub(super) chunks_size: usize,
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
    pub(super) fn read(folder: &Path) -> Result<Self, String> {
        let path = folder.join(INFO);
        let length = fs::metadata(&path).map_err(|error| error.to_string())?.len();
        if length > MAX_BYTES {
            return Err(format!("`{INFO}` has {length} bytes"));
        }
        let bytes = fs::read(&path).map_err(|error| error.to_string())?;
        let info: Self = serde_json::from_slice(&bytes).map_err(|error| format!("`{INFO}`: {error}"))?;
        info.version()?;
        match info.fps.is_finite() && info.fps > 0.0 && info.chunks_size > 0 {
            true => Ok(info),
            false => Err(format!(
                "`{INFO}`: {} frames per second, {} episodes per chunk",
                info.fps, info.chunks_size
            )),
        }
    }

    pub(super) fn version(&self) -> Result<Version, String> {
        match self.codebase_version.as_str() {
            version if version.starts_with("v2.") => Ok(Version::V2),
            version if version.starts_with("v3.") => Ok(Version::V3),
            other => Err(format!("its version is `{other}`; v2.1 and v3.0 are read")),
        }
    }

    /// The table of an episode.
    pub(super) fn data(&self, folder: &Path, numbers: &[(&str, usize)]) -> Result<PathBuf, String> {
        inside(folder, &filled(&self.data_path, numbers, ""))
    }

    /// The film of a camera.
    pub(super) fn film(
        &self,
        folder: &Path,
        camera: &str,
        numbers: &[(&str, usize)],
    ) -> Result<PathBuf, String> {
        let path = self.video_path.as_deref().ok_or("it names no place for its films")?;
        inside(folder, &filled(path, numbers, camera))
    }
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
fn inside(folder: &Path, path: &str) -> Result<PathBuf, String> {
    let relative = Path::new(path);
    let stays = relative.components().all(|part| matches!(part, Component::Normal(_)));
    match stays && !path.contains(['\0', '\\', '{']) {
        true => Ok(folder.join(relative)),
        false => Err(format!("`{INFO}` names the file `{path}`, which is none inside the folder")),
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
