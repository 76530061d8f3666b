//! `meta/stats.json`: least, greatest, mean and spread of every feature, by which LeRobot normalizes. Images count by
//! color, between 0 and 1, every tenth of an episode's. Values that are not finite do not count.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};
use swm_core::{Batch, Dtype, Field, Slice};

use super::manifest::{Manifest, is_video};
use crate::dataset::{Dataset, pieces};
use crate::error::DataError;
use crate::formats::disk::{read_regular, replace};

/// Where they lie.
const STATISTICS: &str = "meta/stats.json";
/// What they were computed from, to go on with: LeRobot's file does not say how many values were finite.
const STATE: &str = "meta/swm-stats.json";
/// One frame in so many counts.
const FRAME_STRIDE: usize = 10;

/// What has been seen of one number of a feature.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Seen {
    count: f64,
    mean: f64,
    /// Sum of squared distances from the mean.
    squares: f64,
    min: f64,
    max: f64,
}

const NOTHING: Seen = Seen { count: 0.0, mean: 0.0, squares: 0.0, min: f64::MAX, max: f64::MIN };

impl Seen {
    /// Welford's update.
    fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.count += 1.0;
        let distance = value - self.mean;
        self.mean += distance / self.count;
        self.squares += distance * (value - self.mean);
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    /// Levels of a color, between 0 and 1, by how often each of the 256 was seen (Chan's update).
    fn add_levels(&mut self, levels: &[u64; 256]) {
        let value = |level: usize| level as f64 / 255.0;
        let count: f64 = levels.iter().map(|&times| times as f64).sum();
        if count == 0.0 {
            return;
        }
        let mean =
            levels.iter().enumerate().map(|(at, &times)| times as f64 * value(at)).sum::<f64>() / count;
        let squares: f64 =
            levels.iter().enumerate().map(|(at, &times)| times as f64 * (value(at) - mean).powi(2)).sum();
        let (all, distance) = (self.count + count, mean - self.mean);
        self.squares += squares + distance * distance * self.count * count / all;
        self.mean += distance * count / all;
        self.count = all;
        for (level, _) in levels.iter().enumerate().filter(|&(_, &times)| times > 0) {
            self.min = self.min.min(value(level));
            self.max = self.max.max(value(level));
        }
    }
}

/// Of all columns that hold numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Statistics {
    /// By column: its numbers; empty for texts.
    columns: Vec<Vec<Seen>>,
    rows: usize,
    /// By column of images: how often each level of a color was seen in the open episode.
    #[serde(skip)]
    levels: Vec<Levels>,
}

/// By color and level.
type Levels = [[u64; 256]; 3];

impl Statistics {
    pub(super) fn new(manifest: &Manifest) -> Self {
        let columns = manifest.columns.iter().map(|field| vec![NOTHING; numbers_of(field)]).collect();
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
                    for at in 0..values.len() {
                        seen[at % field.dim()].add(values.as_f64(at).unwrap_or(f64::NAN));
                    }
                }
            }
        }
    }

    /// Ends the open episode.
    pub(super) fn end_episode(&mut self) {
        for (seen, levels) in self.columns.iter_mut().zip(&mut self.levels) {
            seen.iter_mut().zip(&*levels).for_each(|(seen, levels)| seen.add_levels(levels));
            *levels = [[0; 256]; 3];
        }
    }

    /// Writes them.
    pub(super) fn write(&self, folder: &Path, manifest: &Manifest) -> Result<(), DataError> {
        let mut all = Map::new();
        for (field, seen) in manifest.columns.iter().zip(&self.columns).filter(|(_, seen)| !seen.is_empty()) {
            let number = |value: &dyn Fn(&Seen) -> f64| -> Json {
                let one = |seen: &Seen| if seen.count > 0.0 { json!(value(seen)) } else { json!(0.0) };
                // Of images, `[3, 1, 1]`.
                seen.iter()
                    .map(|seen| if is_video(field) { json!([[one(seen)]]) } else { one(seen) })
                    .collect()
            };
            let value = json!({
                "min": number(&|seen| seen.min),
                "max": number(&|seen| seen.max),
                "mean": number(&|seen| seen.mean),
                "std": number(&|seen| (seen.squares / seen.count).max(0.0).sqrt()),
                "count": [self.rows],
            });
            all.insert(manifest.feature(&field.name), value);
        }
        let state = serde_json::to_vec(self);
        for (name, bytes) in [(STATISTICS, serde_json::to_vec(&all)), (STATE, state)] {
            let path = folder.join(name);
            let bytes = bytes.map_err(|error| DataError::record(&path, error))?;
            replace(&path, &bytes).map_err(|source| DataError::io(&path, "write", source))?;
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

    /// Reads all episodes.
    pub(super) fn compute(manifest: &Manifest, dataset: &mut dyn Dataset) -> Result<Self, DataError> {
        let mut all = Self::new(manifest);
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        for episode in 0..dataset.num_episodes() {
            for rows in pieces(dataset.schema(), dataset.episode_len(episode)) {
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
