//! HDF5 files of ALOHA and ACT, one for each episode: `episode_0.hdf5`, …
//!
//! Source of the layout: act 742c753c, `record_sim_episodes.py` and `utils.py`; aloha 06369f03, `record_episodes.py`. A row holds what was
//! seen and the action taken from it; what the last action led to is not stored. Images may be JPEG that OpenCV encoded, padded to one length
//! for each episode (mobile ALOHA, `COMPRESS`).

use std::path::Path;
use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::dataset::{Dataset, Steps};
use swm_data::error::{DataError, Result, wrong_type};
use swm_data::{Channels, OpenOptions};

use super::array::{Array, Scratch, Shared};
use super::dataset::Span;
use super::found::Found;
use super::hdf5_files::{Files, has, paths};

const NAME: &str = "aloha";
const START: &str = "episode_";

const IMAGES: &str = "observations/images/";
const ACTION: &str = "action";
/// Arrays of every file.
const SIGNS: [&str; 2] = [ACTION, "observations/qpos"];
/// `DT` of both programs is 0.02 s.
const ROWS_PER_SECOND: f64 = 50.0;

pub(super) fn detect(path: &Path) -> bool {
    paths(path, START).first().is_some_and(|first| has(first, &SIGNS))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let found =
        Files::open(paths(path, START), true, &SIGNS).and_then(|files| find(&files, options.channels));
    let (found, has_encoded) = found.map_err(|error| DataError::damaged(path, error))?;
    found.open(path, NAME, options, if has_encoded { &["channels"] } else { &[] })
}

/// What is there, and whether images of it are encoded.
fn find(files: &Files, channels: Option<Channels>) -> Result<(Found, bool)> {
    let mut found = Found { fps: Some(ROWS_PER_SECOND), ..Found::default() };
    for file in 0..files.len() {
        found.lengths.push(files.array(file, ACTION)?.rows());
    }
    let whole = |(array, &count): (usize, &usize)| Span { array, first: 0, count, tail: None };
    let spans: Vec<Span> = found.lengths.iter().enumerate().map(whole).collect();
    let mut has_encoded = false;
    for table in files.tables() {
        let name = table.replace('/', ".");
        let mut arrays = match files.arrays(&table, &found.lengths) {
            Ok(arrays) => arrays,
            Err(error) if SIGNS.contains(&table.as_str()) => return Err(error),
            Err(error) => {
                found.skipped.push((name, error.to_string()));
                continue;
            }
        };
        if arrays.iter().flatten().any(|array| array.is_encoded()) {
            has_encoded = true;
            match channels {
                None => {
                    found.skipped.push((name, UNKNOWN_CHANNELS.to_owned()));
                    continue;
                }
                Some(Channels::Rgb) => {
                    arrays = arrays.into_iter().map(|array| array.map(exchanged)).collect();
                }
                Some(Channels::Bgr) => {}
            }
        } else if table.starts_with(IMAGES) && arrays.iter().flatten().any(|array| array.shape().len() == 1) {
            found.skipped.push((name, "its images are encoded, and not as JPEG".to_owned()));
            continue;
        }
        found.add_partial(&table, &name, arrays, &spans);
    }
    found.notes.push(
        "it does not say its rate; the 50 rows per second of ALOHA are assumed; ACT trains on a real robot's row with the action of the row \
         before, here each has its own"
            .to_owned(),
    );
    Ok((found, has_encoded))
}

const UNKNOWN_CHANNELS: &str = "its images were encoded by OpenCV, which takes what it is given for BGR, and the file does not tell what it was given; \
                                the option `channels` does: `rgb` or `bgr`";

/// Images that OpenCV took for BGR; others as they are.
fn exchanged(array: Shared) -> Shared {
    if array.is_encoded() { Arc::new(Exchanged(array)) } else { array }
}

/// Images whose red and blue OpenCV exchanged.
#[derive(Debug)]
struct Exchanged(Shared);

impl Array for Exchanged {
    fn dtype(&self) -> Dtype {
        self.0.dtype()
    }

    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let SliceMut::U8(out) = out else { return Err(wrong_type("images hold bytes")) };
        self.0.read(rows, SliceMut::U8(&mut *out), scratch)?;
        if self.shape().last() == Some(&3) {
            out.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
        }
        Ok(())
    }
}
