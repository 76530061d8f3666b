//! Statistics on disk: a JSON file beside a dataset. Every format can have one, and none has to know of it.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use swm_core::Dtype;
use swm_files::remote::is_remote;
use swm_files::{beside, read_regular, replace};

use super::{ColumnStatistics, Statistics, StatisticsOptions};
use crate::dataset::Dataset;
use crate::error::DataError;

/// Where the statistics of the dataset at `path` are: `data.h5.stats.json`; beside a folder too, since the reference's
/// readers take every file inside for a column. Those of one that is open and lies elsewhere are in the cache.
pub fn side_file(path: &Path) -> PathBuf {
    #[cfg(feature = "remote")]
    if let Some(file) = swm_files::remote::side_file(path, ".stats.json") {
        return file;
    }
    beside(path, ".stats.json")
}

impl Statistics {
    /// The statistics that are kept with a dataset; `None` if there are none, or only those of fewer or more episodes.
    ///
    /// # Errors
    ///
    /// The file beside the dataset cannot be read, or is damaged.
    pub fn load(dataset: &dyn Dataset) -> Result<Option<Self>, DataError> {
        let path = side_file(dataset.path());
        let text = match read_regular(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(DataError::io(&path, "read", error)),
        };
        let statistics: Self = serde_json::from_slice(&text)
            .map_err(|error| DataError::damaged(&path, format!("{error}; remove it")))?;
        Ok(statistics.fits(dataset).then_some(statistics))
    }

    /// Keeps these with a dataset, in place of those that it had.
    ///
    /// # Errors
    ///
    /// The dataset is not on disk, these are the statistics of another, or the file beside it cannot be written.
    pub fn store(&self, dataset: &dyn Dataset) -> Result<PathBuf, DataError> {
        let path = side_file(dataset.path());
        if !dataset.path().exists() && !is_remote(dataset.path()) {
            return Err(DataError::request(
                dataset.path(),
                "it is not on disk, so there is no place beside it",
            ));
        }
        if !self.fits(dataset) {
            return Err(DataError::request(dataset.path(), "these are the statistics of another dataset"));
        }
        let mut text =
            serde_json::to_vec_pretty(self).map_err(|error| DataError::record(&path, error.to_string()))?;
        text.push(b'\n');
        replace(&path, &text).map_err(|error| DataError::io(&path, "write", error))?;
        Ok(path)
    }

    /// Those of the statistics that are kept with a dataset that are asked for, if all of them are there; else computes them, and keeps them
    /// where that is possible: shared data often lies where nobody may write.
    ///
    /// # Errors
    ///
    /// As of [`Statistics::load`] and [`Statistics::compute`]. That nothing can be written beside the dataset is
    /// none.
    pub fn load_or_compute(
        dataset: &mut dyn Dataset,
        options: &StatisticsOptions,
    ) -> Result<Self, DataError> {
        let fields = dataset.schema().clone();
        let numbers = fields.fields().iter().filter(|field| field.dtype != Dtype::Str);
        let wanted: Vec<&String> = match &options.keys {
            Some(keys) => keys.iter().collect(),
            None => numbers.map(|field| &field.name).collect(),
        };
        if let Some(mut kept) = Self::load(dataset)?
            && wanted
                .iter()
                .all(|key| kept.columns.get(*key).is_some_and(|column| column.has(&options.quantiles)))
        {
            kept.columns.retain(|name, _| wanted.contains(&name));
            return Ok(kept);
        }
        let statistics = Self::compute(dataset, options)?;
        match statistics.store(dataset) {
            Err(DataError::Io { .. }) => Ok(statistics),
            stored => stored.map(|_| statistics),
        }
    }
}

impl ColumnStatistics {
    /// Whether these quantiles are among its own.
    fn has(&self, quantiles: &[f64]) -> bool {
        quantiles
            .iter()
            .all(|wanted| self.rows == 0 || self.quantiles.iter().any(|(level, _)| level == wanted))
    }
}
