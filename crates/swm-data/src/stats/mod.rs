//! Statistics of columns for normalization: mean and standard deviation, extremes, quantiles; found in one pass and
//! kept beside the dataset, whatever its format.
//!
//! Of images (u8, rank 3) there is one set of numbers per channel, of all other columns one per value of a row. Rows
//! that hold a NaN or an infinity, such as the missing action of an episode's last row, do not count. An episode column
//! counts once per episode.

mod accumulate;
mod side_file;

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use swm_core::moments::divisor;
use swm_core::{Column, Dtype, Field, FieldKind, Slice};

use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

pub use side_file::side_file;

use accumulate::{Accumulate, Histograms, Rows};

/// What is to be found out.
#[derive(Clone, Debug, PartialEq)]
pub struct StatisticsOptions {
    /// The columns; `None`: all but texts.
    pub keys: Option<Vec<String>>,
    /// Quantiles, each from 0 to 1.
    pub quantiles: Vec<f64>,
    /// Rows of a column that are kept for its quantiles. Of longer columns a random sample of so many is taken, the same
    /// one every time. (Quantiles of images are always exact.)
    pub sample: usize,
}

impl Default for StatisticsOptions {
    /// All columns; quantiles 1, 5, 25, 50, 75, 95 and 99 %, exact up to 200,000 rows.
    fn default() -> Self {
        Self { keys: None, quantiles: vec![0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99], sample: 200_000 }
    }
}

/// Statistics of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Statistics {
    /// The version of this record.
    pub version: u32,
    /// Episodes of the dataset.
    pub episodes: u64,
    /// Rows of all of them.
    pub rows: u64,
    /// By column.
    pub columns: BTreeMap<String, ColumnStatistics>,
}

/// Statistics of one column. Lists are over channels of images, else over values of a row.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ColumnStatistics {
    /// Rows that count.
    pub rows: u64,
    /// Rows that do not, because not all of their values are finite.
    pub not_finite: u64,
    /// Means; empty if no row counts, as are all other lists then.
    pub mean: Vec<f64>,
    /// Standard deviations, of the population (divided by the number of rows); where squares of differences are beyond f64, of the rows
    /// that quantiles are of.
    pub std: Vec<f64>,
    /// Least values.
    pub min: Vec<f64>,
    /// Greatest values.
    pub max: Vec<f64>,
    /// Each wanted quantile and its values, by linear interpolation between the sorted rows, as numpy does by default.
    pub quantiles: Vec<(f64, Vec<f64>)>,
    /// Whether the quantiles are of all rows, and not of a sample.
    pub quantiles_exact: bool,
}

/// The version of [`Statistics`] that is written.
const VERSION: u32 = 1;
/// How much of a column is read at once.
const PIECE_BYTES: usize = 8 << 20;

impl Statistics {
    /// Reads the chosen columns once, from the first row to the last.
    ///
    /// # Errors
    ///
    /// Quantiles outside of 0 to 1, a sample of 0 rows, a column that does not exist or holds text, or reading fails.
    pub fn compute(dataset: &mut dyn Dataset, options: &StatisticsOptions) -> Result<Self, DataError> {
        let wrong = |setting, reason: String| Err(DataError::Loader { setting, reason });
        if let Some(bad) = options.quantiles.iter().find(|q| !(0.0..=1.0).contains(*q)) {
            return wrong("quantiles", format!("{bad} is not between 0 and 1"));
        }
        if options.sample == 0 {
            return wrong("sample", "0 rows; use 1 or more".to_owned());
        }
        let schema = dataset.schema().clone();
        let chosen: Vec<usize> = match &options.keys {
            None => (0..schema.fields().len()).filter(|&c| schema.fields()[c].dtype != Dtype::Str).collect(),
            Some(keys) => keys
                .iter()
                .map(|key| schema.require(key))
                .collect::<Result<_, _>>()
                .map_err(|error| DataError::request(dataset.path(), error))?,
        };
        let fields: Vec<&Field> = chosen.iter().map(|&column| &schema.fields()[column]).collect();
        if let Some(text) = fields.iter().find(|field| field.dtype == Dtype::Str) {
            return wrong("keys", format!("column `{}` holds text, which has no statistics", text.name));
        }
        // Images are what takes time: each column of them goes to a thread, and the others, which some formats decode at once,
        // to another. A column's rows are summed in their order, whatever the number of threads.
        let is_image = |&column: &usize| schema.fields()[column].shape.len() == 3;
        let (images, others): (Vec<usize>, Vec<usize>) = chosen.iter().copied().partition(is_image);
        let groups = [others].into_iter().chain(images.into_iter().map(|column| vec![column]));
        let groups: Vec<_> = groups.map(|columns| (columns, dataset.share())).collect();
        let found =
            groups.into_par_iter().map(|(columns, mut dataset)| of_columns(&mut *dataset, &columns, options));
        let mut columns = BTreeMap::new();
        for group in found.collect::<Vec<_>>() {
            columns.extend(group?);
        }
        let rows = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode) as u64).sum();
        Ok(Self { version: VERSION, episodes: dataset.num_episodes() as u64, rows, columns })
    }

    /// Whether these may be the statistics of `dataset`: episodes and rows agree, and every column is one of it.
    fn fits(&self, dataset: &dyn Dataset) -> bool {
        let lengths = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode) as u64);
        self.version == VERSION
            && self.episodes == dataset.num_episodes() as u64
            && self.rows == lengths.sum::<u64>()
            && self.columns.keys().all(|name| dataset.schema().index(name).is_some())
    }
}

/// The statistics of rows in memory, `[N, D]` end to end with D = `dim`; quantiles are of all rows.
pub fn of_rows(rows: Slice<'_>, dim: usize, quantiles: &[f64]) -> ColumnStatistics {
    let mut found = Rows::new(dim, if quantiles.is_empty() { 0 } else { usize::MAX }, 0);
    found.add(rows);
    found.finish(quantiles)
}

/// The statistics of some columns, in one pass, with their names.
fn of_columns(
    dataset: &mut dyn Dataset,
    columns: &[usize],
    options: &StatisticsOptions,
) -> Result<Vec<(String, ColumnStatistics)>, DataError> {
    let schema = dataset.schema().clone();
    let capacity = if options.quantiles.is_empty() { 0 } else { options.sample };
    let begun = columns.iter().map(|&column| -> (usize, &Field, Box<dyn Accumulate>, Column) {
        let field = &schema.fields()[column];
        let found: Box<dyn Accumulate> = match (&field.shape[..], field.dtype) {
            (&[_, _, channels], Dtype::U8) => Box::new(Histograms::new(channels)),
            _ => Box::new(Rows::new(field.dim(), capacity, column as u64)),
        };
        (column, field, found, Column::zeros(field.dtype, 0))
    });
    let mut begun: Vec<_> = begun.collect();
    for episode in 0..dataset.num_episodes() {
        let len = dataset.episode_len(episode);
        for (column, field, found, buffer) in &mut begun {
            let counted = if field.kind == FieldKind::Episode { len.min(1) } else { len };
            let piece = (PIECE_BYTES / (8 * field.dim()).max(1)).max(1);
            for first in (0..counted).step_by(piece) {
                let count = piece.min(counted - first);
                buffer.resize(count * field.dim());
                let steps = Steps { first, count, stride: 1 };
                dataset.read_column(*column, episode, steps, buffer.as_slice_mut())?;
                found.add(buffer.as_slice());
            }
        }
    }
    let finished = begun
        .into_iter()
        .map(|(_, field, mut found, _)| (field.name.clone(), found.finish(&options.quantiles)));
    Ok(finished.collect())
}

impl ColumnStatistics {
    /// Makes values, `[…, D]` with the `D` of this column, of mean 0 and standard deviation 1. [Constants](swm_core::moments::is_constant)
    /// become 0: they are only shifted.
    pub fn standardize(&self, values: &mut [f32]) {
        for row in values.chunks_mut(self.mean.len().max(1)) {
            for ((value, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *value = ((f64::from(*value) - mean) / divisor(*mean, *std)) as f32;
            }
        }
    }

    /// The inverse of [`standardize`](Self::standardize).
    pub fn restore(&self, values: &mut [f32]) {
        for row in values.chunks_mut(self.mean.len().max(1)) {
            for ((value, mean), std) in row.iter_mut().zip(&self.mean).zip(&self.std) {
                *value = (f64::from(*value) * divisor(*mean, *std) + mean) as f32;
            }
        }
    }
}
