//! HDF5 files of V-D4RL, images of 84 × 84: flat arrays of all steps, whose `step_type` marks where episodes begin and end.
//!
//! Source of the layout: v-d4rl 1ceaf220, `conversion_scripts` and `drqbc/numpy_replay_buffer.py`. A row holds an image, and the action and
//! reward that led to it. Files are cut into shards by rows, also amid an episode.

use std::path::Path;

use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{DataError, Result, invalid};

use super::array::{Memory, Scratch, numbers};
use super::dataset::Span;
use super::found::{Found, Source};
use super::hdf5_files::{Files, has, paths};

const NAME: &str = "vd4rl";

/// Arrays of every file.
const SIGNS: [&str; 5] = ["observation", "action", "reward", "discount", STEP_TYPE];
/// What led to a row.
const LED: [&str; 2] = ["action", "reward"];

const STEP_TYPE: &str = "step_type";
/// Values of `step_type`, as of dm_env.
const FIRST: f64 = 0.0;
const LAST: f64 = 2.0;

pub(super) fn detect(path: &Path) -> bool {
    paths(path, "").first().is_some_and(|first| has(first, &SIGNS))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let found = Files::open(paths(path, ""), false, &SIGNS).and_then(|files| find(&files));
    found.map_err(|error| DataError::damaged(path, error))?.open(path, NAME, options, &[])
}

/// An episode, or the part of it that a file holds.
struct Part {
    file: usize,
    first: usize,
    rows: usize,
}

fn find(files: &Files) -> Result<Found> {
    let scratch = &mut Scratch::default();
    let (mut parts, mut terminated, mut truncated) = (Vec::new(), Vec::new(), Vec::new());
    let mut lengths = Vec::with_capacity(files.len());
    for file in 0..files.len() {
        let types = numbers(files.array(file, STEP_TYPE)?.as_ref(), scratch)?;
        let discounts = numbers(files.array(file, "discount")?.as_ref(), scratch)?;
        lengths.push(types.len());
        for (row, &step) in types.iter().enumerate() {
            if row == 0 || step == FIRST || types[row - 1] == LAST {
                parts.push(Part { file, first: row, rows: 0 });
            }
            if let Some(part) = parts.last_mut() {
                part.rows += 1;
            }
            let is_terminal = discounts.get(row) == Some(&0.0);
            terminated.push(step == LAST && is_terminal);
            truncated.push(step == LAST && !is_terminal);
        }
    }
    let mut found = Found { lengths: parts.iter().map(|part| part.rows).collect(), ..Found::default() };
    // What led to a row belongs to the row before.
    let spans = |skipped: usize| -> Vec<Span> {
        let of = |part: &Part| {
            let skipped = skipped.min(part.rows);
            Span { array: part.file, first: part.first + skipped, count: part.rows - skipped, tail: None }
        };
        parts.iter().map(of).collect()
    };
    let (whole, without_first) = (spans(0), spans(1));
    for table in files.tables() {
        let is_sign = SIGNS.contains(&table.as_str());
        match files.arrays(&table, &lengths) {
            Ok(arrays) => {
                let spans = if LED.contains(&table.as_str()) { &without_first } else { &whole };
                found.add_partial(&table, &table, arrays, spans);
            }
            Err(error) if is_sign => return Err(error),
            Err(error) => found.skipped.push((table, error.to_string())),
        }
    }
    if found.lengths.is_empty() {
        return Err(invalid("it has no rows"));
    }
    for (name, marks) in [("terminated", terminated), ("truncated", truncated)] {
        let spans = found.end_to_end();
        found.sources.push(Source::step(name, name, vec![Memory::marks(marks)], spans));
    }
    found.notes.push(
        "its rows hold the action and the reward that led to an image; here they are in the row before, from which the action was taken, \
         and missing in the last row of an episode; `discount` and `step_type` are in the row of their image; an episode of which a file holds a \
         part alone is one of its own"
            .to_owned(),
    );
    Ok(found)
}
