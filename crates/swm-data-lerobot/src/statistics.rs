//! `meta/stats.json`: least, greatest, mean and std of every feature, by which LeRobot normalizes. Images count by
//! color, between 0 and 1, every tenth of an episode's. Rows with a value that is not finite do not count.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};
use swm_core::moments::Moments;
use swm_core::{Batch, Dtype, Field, Slice};
use swm_data::dataset::{Dataset, pieces};
use swm_data::error::DataError;
use swm_files::{read_regular, replace_unsynced};

use super::manifest::{Manifest, is_video};

/// Where they lie.
const STATISTICS: &str = "meta/stats.json";
/// What they were computed from, to go on with.
const STATE: &str = "meta/swm-stats.json";
/// One frame in so many counts.
const FRAME_STRIDE: usize = 10;

/// Of all columns that hold numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Statistics {
    /// By column: its numbers; empty for texts.
    columns: Vec<Vec<Moments>>,
    rows: usize,
    /// By column of images: how often each level of a color was seen in the open episode.
    #[serde(skip)]
    levels: Vec<Levels>,
}

/// By color and level.
type Levels = [[u64; 256]; 3];

impl Statistics {
    pub(super) fn new(manifest: &Manifest) -> Self {
        let columns =
            manifest.columns.iter().map(|field| vec![Moments::default(); numbers_of(field)]).collect();
        Self { columns, rows: 0, levels: Vec::new() }
    }

    /// Adds rows of the open episode from `first` on, as a table that has the manifest's columns by name.
    pub(super) fn add(&mut self, manifest: &Manifest, first: usize, batch: &Batch) {
        self.rows += batch.rows();
        self.levels.resize(manifest.columns.len(), [[0; 256]; 3]);
        let columns = manifest.columns.iter().zip(&mut self.columns).zip(&mut self.levels);
        for ((field, seen), levels) in columns {
            let Some(column) = batch.schema().index(&field.name) else { continue };
            match batch.column(column) {
                Slice::Str(_) => {}
                Slice::U8(values) if is_video(field) => {
                    let frames = values.chunks_exact(field.dim());
                    for frame in
                        frames.skip(first.next_multiple_of(FRAME_STRIDE) - first).step_by(FRAME_STRIDE)
                    {
                        for pixel in frame.as_chunks::<3>().0 {
                            pixel
                                .iter()
                                .zip(&mut *levels)
                                .for_each(|(&value, levels)| levels[usize::from(value)] += 1);
                        }
                    }
                }
                values => {
                    let mut row = vec![0.0; field.dim()];
                    for first in (0..values.len()).step_by(field.dim().max(1)) {
                        let number = |at| values.as_f64(first + at).unwrap_or(f64::NAN);
                        row.iter_mut().enumerate().for_each(|(at, value)| *value = number(at));
                        // The file has one count for all numbers of a row.
                        if row.iter().all(|value| value.is_finite()) {
                            seen.iter_mut().zip(&row).for_each(|(seen, &value)| seen.add(value));
                        }
                    }
                }
            }
        }
    }

    /// Ends the open episode.
    pub(super) fn end_episode(&mut self) {
        for (seen, levels) in self.columns.iter_mut().zip(&mut self.levels) {
            for (seen, levels) in seen.iter_mut().zip(&*levels) {
                for (level, &times) in levels.iter().enumerate() {
                    seen.add_times(level as f64 / 255.0, times);
                }
            }
            *levels = [[0; 256]; 3];
        }
    }

    /// Writes them.
    pub(super) fn write(&self, folder: &Path, manifest: &Manifest) -> Result<(), DataError> {
        let mut all = Map::new();
        for (field, seen) in manifest.columns.iter().zip(&self.columns).filter(|(_, seen)| !seen.is_empty()) {
            let number = |value: fn(&Moments) -> f64| -> Json {
                // Of images, `[3, 1, 1]`.
                seen.iter()
                    .map(|seen| if is_video(field) { json!([[value(seen)]]) } else { json!(value(seen)) })
                    .collect()
            };
            // Rows or frames, by which LeRobot weighs datasets that it joins.
            let pixels = if is_video(field) { (field.dim() / 3).max(1) as u64 } else { 1 };
            let count = seen.first().map_or(0, |seen| seen.count() / pixels);
            let value = json!({
                "min": number(Moments::min),
                "max": number(Moments::max),
                "mean": number(Moments::mean),
                "std": number(Moments::std),
                "count": [count],
            });
            all.insert(manifest.feature(&field.name), value);
        }
        let state = serde_json::to_vec(self);
        for (name, bytes) in [(STATISTICS, serde_json::to_vec(&all)), (STATE, state)] {
            let path = folder.join(name);
            let bytes = bytes.map_err(|error| DataError::record(&path, error))?;
            replace_unsynced(&path, &bytes).map_err(|source| DataError::io(&path, "write", source))?;
        }
        Ok(())
    }

    /// Those of the folder, if they are of exactly `rows` rows.
    pub(super) fn read(folder: &Path, manifest: &Manifest, rows: usize) -> Option<Self> {
        let found: Self = serde_json::from_slice(&read_regular(&folder.join(STATE)).ok()?).ok()?;
        let fits = found.columns.len() == manifest.columns.len()
            && found
                .columns
                .iter()
                .zip(&manifest.columns)
                .all(|(seen, field)| seen.len() == numbers_of(field));
        (fits && found.rows == rows && folder.join(STATISTICS).is_file()).then_some(found)
    }

    /// Reads so many rows of each episode.
    pub(super) fn compute(
        manifest: &Manifest,
        dataset: &mut dyn Dataset,
        rows: &[usize],
    ) -> Result<Self, DataError> {
        let mut all = Self::new(manifest);
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        for (episode, &count) in rows.iter().enumerate() {
            for rows in pieces(dataset.schema(), count) {
                let first = rows.start;
                dataset.read(episode, rows, &mut batch)?;
                all.add(manifest, first, &batch);
            }
            all.end_episode();
        }
        Ok(all)
    }
}

/// How many numbers of a column are looked at one by one.
fn numbers_of(field: &Field) -> usize {
    match field.dtype {
        Dtype::Str => 0,
        _ if is_video(field) => 3,
        _ => field.dim(),
    }
}
