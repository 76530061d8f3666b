//! Statistics of columns, kept beside the dataset.

use std::path::PathBuf;

use serde_json::json;
use swm_core::Registry;
use swm_core::error::{did_you_mean, nearest};
use swm_data::adapt::Watched;
use swm_data::stats::{Statistics, StatisticsOptions, side_file};
use swm_data::{Dataset, OpenOptions};

use super::copies::{check_exists, ended};
use super::{Message, Report, Request, TaskError, apart, must_be_given, open_dataset_with, wrong};
use crate::threads::{self, within};

swm_core::settings! {
    /// Find mean, std, extremes and quantiles of columns; keep them beside the dataset.
    pub struct Stats {
        /// The dataset.
        dataset: PathBuf = PathBuf::new() => "must be given",
        /// Only these columns.
        columns: Option<Vec<String>> = None => "all but texts",
        /// Quantiles, each from 0 to 1.
        quantiles: Option<Vec<f64>> = None => "0.01, 0.05, 0.25, 0.5, 0.75, 0.95 and 0.99",
        /// Whether they are kept in `<dataset>.stats.json`, and taken from there.
        store: bool = true,
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
    }
}

impl Request for Stats {
    const NAME: &'static str = "stats";
    type Outcome = Statistics;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("dataset", self.dataset.as_os_str().is_empty())])?;
        if let Some(bad) = self.quantiles.iter().flatten().find(|level| !(0.0..=1.0).contains(*level)) {
            return Err(Message::about("quantiles", *bad, "each is a number from 0 to 1").into());
        }
        threads::check(self.threads)?;
        self.opening.check().map_err(wrong)?;
        check_exists(&self.dataset)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Statistics, TaskError> {
        self.check(registry)?;
        let dataset = apart(report, || open_dataset_with(registry, &self.dataset, &self.opening))??;
        self.check_columns(dataset.as_ref())?;
        let mut dataset = Watched::new(dataset, report.cancel());
        let default = StatisticsOptions::default();
        let quantiles = self.quantiles.clone().unwrap_or(default.quantiles);
        let options = StatisticsOptions { keys: self.columns.clone(), quantiles, ..default };
        let find = || match self.store {
            true => Statistics::load_or_compute(&mut dataset, &options),
            false => Statistics::compute(&mut dataset, &options),
        };
        let found = apart(report, || within(self.threads, find))??;
        let found = found.map_err(|error| ended(error.into(), report))?;
        if self.store {
            let file = side_file(dataset.path());
            match Statistics::load(&dataset)? {
                Some(_) => report.info(&Message::new(format!("kept in {}", file.display()))),
                None => report.note(&Message::new(format!("not kept: {} cannot be written", file.display()))),
            }
        }
        Ok(found)
    }
}

impl Stats {
    fn check_columns(&self, dataset: &dyn Dataset) -> Result<(), TaskError> {
        let schema = dataset.schema();
        let Some(unknown) = self.columns.iter().flatten().find(|name| schema.index(name).is_none()) else {
            return Ok(());
        };
        let names: Vec<&str> = schema.fields().iter().map(|field| field.name.as_str()).collect();
        let meant = did_you_mean(nearest(unknown, names.iter().copied()).as_deref());
        let file = dataset.path().display();
        let text = format!("{file} has no column `{unknown}`{meant}; it has {}", names.join(", "));
        Err(Message::about("columns", json!(self.columns), text).into())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value as Json;
    use swm_data::WriteMode;
    use swm_data::testing::record;

    use super::*;

    #[test]
    fn statistics_are_found_and_kept_and_every_refusal_names_its_setting() {
        let folder = tempfile::tempdir().unwrap();
        let registry = Registry::new().with(swm_data::FORMATS);
        let data = folder.path().join("a.h5");
        record(&data, WriteMode::Error, 0..3).unwrap();
        let ask = |given: &Json, notes: &mut Vec<Message>| {
            Stats::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, notes))
        };
        let mut notes = Vec::new();
        let given = json!({ "dataset": data, "columns": ["action"], "quantiles": [0.5], "store": false });
        let found = ask(&given, &mut notes).unwrap();
        assert!(found.columns.len() == 1 && notes.is_empty() && !side_file(&data).exists(), "{notes:?}");
        let all = ask(&json!({ "dataset": data }), &mut notes).unwrap();
        assert!(all.columns.len() > 1 && side_file(&data).is_file() && notes.is_empty(), "{notes:?}");
        for (given, text) in [
            (json!({}), "dataset: must be given"),
            (json!({ "dataset": data, "columns": ["acton"] }), "did you mean `action`?"),
            (
                json!({ "dataset": data, "quantiles": [0.5, 2] }),
                "quantiles=2.0: each is a number from 0 to 1",
            ),
            (json!({ "dataset": data, "threads": 0 }), "threads"),
        ] {
            let error = ask(&given, &mut Vec::new()).unwrap_err();
            assert!(matches!(error, TaskError::Request(_)), "{error}");
            assert!(error.to_string().contains(text), "{text}: {error}");
        }
    }
}
