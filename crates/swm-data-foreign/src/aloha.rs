//! HDF5 files of ALOHA and ACT, one for each episode: `episode_0.hdf5`, …
//!
//! Source of the layout: act 742c753c, `record_sim_episodes.py` and `utils.py`; aloha 06369f03, `record_episodes.py`. A row holds what was
//! seen and the action taken from it; what the last action led to is not stored.

use std::path::Path;

use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{DataError, Result};

use super::dataset::Span;
use super::found::{Found, Source};
use super::hdf5_files::{Files, has, paths};

const NAME: &str = "aloha";
const START: &str = "episode_";

const ACTION: &str = "action";
/// Arrays of every file.
const SIGNS: [&str; 2] = [ACTION, "observations/qpos"];
const IMAGES: &str = "observations/images/";
/// `DT` of both programs is 0.02 s.
const ROWS_PER_SECOND: f64 = 50.0;

pub(super) fn detect(path: &Path) -> bool {
    paths(path, START).first().is_some_and(|first| has(first, &SIGNS))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let found = Files::open(paths(path, START)).and_then(|files| find(&files));
    found.map_err(|error| DataError::damaged(path, error))?.open(path, NAME, options, &[])
}

fn find(files: &Files) -> Result<Found> {
    let mut found = Found { fps: Some(ROWS_PER_SECOND), ..Found::default() };
    for file in 0..files.len() {
        found.lengths.push(files.array(file, ACTION)?.rows());
    }
    let whole = |(array, &count): (usize, &usize)| Span { array, first: 0, count, tail: None };
    let spans: Vec<Span> = found.lengths.iter().enumerate().map(whole).collect();
    for table in files.tables() {
        let name = table.replace('/', ".");
        match files.arrays(&table, &found.lengths) {
            Ok(arrays) if table.starts_with(IMAGES) && arrays[0].shape().len() == 1 => {
                let reason = "its images were encoded by OpenCV, which takes RGB for BGR, and the file does not tell which it was given; decode \
                              them with cv2.imdecode, which undoes it, and write the images themselves";
                found.skipped.push((name, reason.to_owned()));
            }
            Ok(arrays) => found.sources.push(Source::step(&table, &name, arrays, spans.clone())),
            Err(error) if SIGNS.contains(&table.as_str()) => return Err(error),
            Err(error) => found.skipped.push((name, error.to_string())),
        }
    }
    found.notes.push(
        "it does not say its rate; the 50 rows per second of ALOHA are assumed; ACT trains on a real robot's row with the action of the row \
         before, here each has its own"
            .to_owned(),
    );
    Ok(found)
}
