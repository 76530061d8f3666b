//! Images and videos for notebooks and results, and intervals of success rates.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use swm::core::env::PIXELS;
use swm::core::error::BoxError;
use swm::core::{EpisodeEnd, LiveStep, Recorder, RunInfo};
use swm::media::{Clip, Format, contact_sheet as sheet, png};
use swm::video::Video;

use crate::arrays::c_slice;
use crate::errors::SwmError;

/// Videos are enlarged to at least this short side, in pixels: players blur smaller ones.
const VIDEO_SIDE: usize = 256;
/// Images per row of a contact sheet.
const COLUMNS: usize = 4;
/// White between them, in pixels.
const GAP: usize = 4;

/// Frames `(T, H, W, 3)`, checked.
fn size(frames: &PyReadonlyArrayDyn<'_, u8>) -> PyResult<[usize; 3]> {
    match *frames.shape() {
        [count, height, width, 3] if count * height * width > 0 => Ok([count, height, width]),
        _ => Err(SwmError::new_err(format!(
            "frames must be uint8 of shape (T, H, W, 3), none of them 0, found {:?}",
            frames.shape()
        ))),
    }
}

fn values<'a>(frames: &'a PyReadonlyArrayDyn<'_, u8>) -> PyResult<&'a [u8]> {
    c_slice(frames).ok_or_else(|| SwmError::new_err("frames must be contiguous; use np.ascontiguousarray"))
}

/// Writes frames `(T, H, W, 3)` as a video (`.mp4`, `.gif`), enlarged if they are small, or as a `.png` with all of them side by side.
#[pyfunction]
fn save_video(
    py: Python<'_>,
    path: &str,
    frames: PyReadonlyArrayDyn<'_, u8>,
    frames_per_second: f64,
) -> PyResult<()> {
    let [_, height, width] = size(&frames)?;
    let mut clip = Clip::new(height, width, frames_per_second);
    for frame in values(&frames)?.chunks_exact(height * width * 3) {
        clip.push(frame).map_err(|error| SwmError::new_err(error.to_string()))?;
    }
    let is_video = !path.ends_with(".png");
    py.detach(|| if is_video { clip.upscaled(VIDEO_SIDE).save(path) } else { clip.save(path) })
        .map_err(|error| SwmError::new_err(format!("cannot write {path}: {error}")))
}

/// Frames `(T, H, W, 3)` as one PNG, four in a row.
#[pyfunction]
fn contact_sheet<'py>(py: Python<'py>, frames: PyReadonlyArrayDyn<'py, u8>) -> PyResult<Bound<'py, PyBytes>> {
    let [_, height, width] = size(&frames)?;
    let frames: Vec<&[u8]> = values(&frames)?.chunks_exact(height * width * 3).collect();
    let rows: Vec<Vec<&[u8]>> = frames.chunks(COLUMNS).map(<[_]>::to_vec).collect();
    let wrong = |error: swm::media::MediaError| SwmError::new_err(error.to_string());
    let (height, width, rgb) = sheet(&rows, height, width, GAP).map_err(wrong)?;
    Ok(PyBytes::new(py, &png::encode(height, width, &rgb).map_err(wrong)?))
}

/// The 95 % Wilson interval of `successes` of `episodes`, in percent.
#[pyfunction]
fn wilson95(successes: usize, episodes: usize) -> (f64, f64) {
    let [low, high] = swm::core::evaluate::wilson95(successes, episodes);
    (low, high)
}

/// Writes `episode_<i>.mp4` of every episode into a folder, each as it ends: memory holds the episodes that run.
pub(crate) struct VideoFolder {
    folder: PathBuf,
    running: Video,
    paths: BTreeMap<u64, String>,
}

impl VideoFolder {
    pub(crate) fn new(folder: &str) -> Self {
        Self { folder: folder.into(), running: Video::first(u64::MAX), paths: BTreeMap::new() }
    }

    /// The videos, by episode.
    pub(crate) fn into_paths(self) -> Vec<String> {
        self.paths.into_values().collect()
    }
}

impl Recorder for VideoFolder {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        if run.schema.index(PIXELS).is_none() {
            return Err(format!(
                "a video needs images, and {} has none here; make the World with image_shape=(height, width)",
                run.spec.id
            )
            .into());
        }
        let refuse = |error| format!("cannot write {}: {error}", self.folder.display());
        fs::create_dir_all(&self.folder).map_err(refuse)?;
        self.running.start(run)
    }

    fn step(&mut self, step: &LiveStep<'_>) -> Result<(), BoxError> {
        self.running.step(step)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        let Some(scene) = self.running.take(end.index) else { return Ok(()) };
        let format = if Format::Mp4.is_built() { Format::Mp4 } else { Format::Gif };
        let path = self.folder.join(format!("episode_{}.{}", end.index, format.extension()));
        let saved = scene.clip.upscaled(VIDEO_SIDE).save(&path);
        saved.map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        self.paths.insert(end.index, path.display().to_string());
        Ok(())
    }
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(save_video, m)?)?;
    m.add_function(wrap_pyfunction!(contact_sheet, m)?)?;
    m.add_function(wrap_pyfunction!(wilson95, m)?)
}
