//! What an evaluation leaves in its folder: `result.json`, a contact sheet, videos.

use std::path::{Path, PathBuf};

use swm_core::Evaluation;
use swm_media::{Clip, Format, contact_sheet, framed, png};

use crate::error::{TaskError, cannot};
use crate::text_file::replace_text;
use crate::video::{Scene, Video};

/// Images per row of the contact sheet, without the goal.
const SHEET_COLUMNS: usize = 8;
/// Videos are enlarged to at least this short side, in pixels: players blur smaller ones.
const MIN_SIDE: usize = 256;
/// And never beyond this long side.
const MAX_SIDE: usize = 2160;

/// Writes all of it and returns the paths.
///
/// # Errors
///
/// A file cannot be written, or a video cannot be encoded.
pub fn write_report(
    dir: &Path,
    evaluation: &Evaluation,
    video: &Video,
    video_format: Format,
) -> Result<Vec<PathBuf>, TaskError> {
    std::fs::create_dir_all(dir).map_err(cannot("write", dir))?;
    let result = dir.join("result.json");
    replace_text(&result, &serde_json::to_string_pretty(evaluation)?).map_err(cannot("write", &result))?;
    let mut written = vec![result];
    let scenes: Vec<(u64, &Scene)> = video.scenes().filter(|(_, scene)| !scene.clip.is_empty()).collect();
    if scenes.is_empty() {
        return Ok(written);
    }
    let sheet = dir.join("episodes.png");
    write_sheet(&sheet, scenes.iter().map(|(_, scene)| *scene))?;
    written.push(sheet);
    for (index, scene) in scenes {
        written.push(save_video(dir, index, scene, video_format)?);
    }
    Ok(written)
}

/// Saves the video of an episode under a name that says how it ended.
pub(crate) fn save_video(
    dir: &Path,
    episode: u64,
    scene: &Scene,
    format: Format,
) -> Result<PathBuf, TaskError> {
    let outcome = match scene.end.and_then(|end| end.success) {
        Some(true) => "success",
        Some(false) => "failure",
        None => "episode",
    };
    let path = dir.join(format!("episode_{episode:03}_{outcome}.{}", format.extension()));
    enlarged(&scene.clip).save(&path)?;
    Ok(path)
}

/// The clip at a size that players do not blur, unless it is so elongated that this would be huge.
fn enlarged(clip: &Clip) -> Clip {
    let (short, long) = (clip.height().min(clip.width()), clip.height().max(clip.width()));
    let factor = MIN_SIDE.div_ceil(short).min(MAX_SIDE / long).max(1);
    clip.upscaled(factor * short)
}

/// One row per episode: the framed goal, then images from first to last.
fn write_sheet<'a>(path: &Path, scenes: impl Iterator<Item = &'a Scene>) -> Result<(), TaskError> {
    let scenes: Vec<&Scene> = scenes.collect();
    let size = scenes.first().map_or((0, 0), |scene| (scene.clip.height(), scene.clip.width()));
    let goals: Vec<Option<Vec<u8>>> =
        scenes.iter().map(|scene| scene.goal.as_ref().map(|goal| framed(goal, size.1))).collect();
    let rows: Vec<Vec<&[u8]>> = scenes
        .iter()
        .zip(&goals)
        .map(|(scene, goal)| {
            let frames: Vec<&[u8]> = scene.clip.frames().collect();
            let last = frames.len() - 1;
            let count = SHEET_COLUMNS.min(frames.len());
            let index = |i: usize| if count == 1 { 0 } else { i * last / (count - 1) };
            let chosen = (0..count).map(|i| frames[index(i)]);
            goal.as_deref().into_iter().chain(chosen).collect()
        })
        .collect();
    let (height, width, rgb) = contact_sheet(&rows, size.0, size.1, 4)?;
    Ok(png::write(path, height, width, &rgb)?)
}
