//! What an evaluation leaves in its folder: `result.json`, a contact sheet, films.

use std::path::{Path, PathBuf};

use swm_core::Evaluation;
use swm_core::error::BoxError;
use swm_media::{contact_sheet, png};

use crate::film::{Film, Scene};

/// Pictures per row of the contact sheet, the goal beside them.
const SHEET_COLUMNS: usize = 8;
/// Films are enlarged to at least this short side, in pixels: players blur smaller ones.
const MIN_SIDE: usize = 256;

/// Writes all of it and returns the paths.
pub fn write_report(
    dir: &Path,
    evaluation: &Evaluation,
    film: &Film,
    film_format: &str,
) -> Result<Vec<PathBuf>, BoxError> {
    let failed =
        |path: &Path, error: &dyn std::fmt::Display| format!("cannot write {}: {error}", path.display());
    std::fs::create_dir_all(dir).map_err(|error| failed(dir, &error))?;
    let result = dir.join("result.json");
    std::fs::write(&result, serde_json::to_string_pretty(evaluation)?)
        .map_err(|error| failed(&result, &error))?;
    let mut written = vec![result];
    let scenes: Vec<(u64, &Scene)> = film.scenes().filter(|(_, scene)| !scene.clip.is_empty()).collect();
    if scenes.is_empty() {
        return Ok(written);
    }
    let sheet = dir.join("episodes.png");
    write_sheet(&sheet, scenes.iter().map(|(_, scene)| *scene))?;
    written.push(sheet);
    for (index, scene) in scenes {
        let outcome = match scene.end.and_then(|end| end.success) {
            Some(true) => "success",
            Some(false) => "failure",
            None => "episode",
        };
        let path = dir.join(format!("episode_{index:03}_{outcome}.{film_format}"));
        scene.clip.upscaled(MIN_SIDE).save(&path)?;
        written.push(path);
    }
    Ok(written)
}

/// One row per episode: moments from first to last, then the goal.
fn write_sheet<'a>(path: &Path, scenes: impl Iterator<Item = &'a Scene>) -> Result<(), BoxError> {
    let mut size = (0, 0);
    let rows: Vec<Vec<&[u8]>> = scenes
        .map(|scene| {
            size = (scene.clip.height(), scene.clip.width());
            let frames: Vec<&[u8]> = scene.clip.frames().collect();
            let last = frames.len() - 1;
            let count = SHEET_COLUMNS.min(frames.len());
            let moment = |i: usize| if count == 1 { 0 } else { i * last / (count - 1) };
            let moments = (0..count).map(|i| frames[moment(i)]);
            moments.chain(scene.goal.as_deref()).collect()
        })
        .collect();
    let (height, width, rgb) = contact_sheet(&rows, size.0, size.1, 4)?;
    Ok(png::write(path, height, width, &rgb)?)
}
