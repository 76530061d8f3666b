//! Recorded actions are repeated on the simulator, and every column of the state is compared.

use std::path::PathBuf;

use serde_json::{Map, Value as Json};
use swm_core::{EnvConfig, Metadata, Registry};
use swm_data::OpenOptions;
use swm_data::adapt::Watched;

use super::copies::{check_exists, ended};
use super::selection::selection;
use super::{
    Report, Request, Stage, TaskError, apart, check_tolerance, factor_values, must_be_given,
    open_dataset_with, wrong,
};
use crate::replay::{ReplayReport, recorded_env, replay};
use crate::threads::{self, within};

swm_core::settings! {
    /// Repeat recorded actions from recorded starts, and compare every column of the state.
    pub struct Replay {
        /// The dataset.
        dataset: PathBuf = PathBuf::new() => "must be given",
        /// The environment's id.
        env: Option<String> = None => "the one that the dataset names",
        /// Settings of the environment, by name, beside those that the dataset names.
        env_option: Map<String, Json> = Map::new() => "none",
        /// Episodes to replay: `5`, `0..10` or `0,3,7`.
        episodes: Option<String> = None => "all",
        /// Factors to set in place of recorded values, by name.
        ///
        /// For files whose simulator interpreted them differently.
        set: Map<String, Json> = Map::new() => "none",
        /// Largest accepted absolute difference of any value.
        tolerance: f64 = 1e-6,
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
    }
}

impl Request for Replay {
    const NAME: &'static str = "replay";
    type Outcome = ReplayReport;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("dataset", self.dataset.as_os_str().is_empty())])?;
        threads::check(self.threads)?;
        check_tolerance(self.tolerance)?;
        self.opening.check().map_err(wrong)?;
        self.env.as_ref().map_or(Ok(()), |id| registry.env(id).map(drop))?;
        check_exists(&self.dataset)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<ReplayReport, TaskError> {
        self.check(registry)?;
        let dataset = apart(report, || open_dataset_with(registry, &self.dataset, &self.opening))??;
        let episodes = selection(self.episodes.as_deref(), dataset.num_episodes())?;
        let entry = match &self.env {
            Some(id) => registry.env(id)?,
            None => recorded_env(registry, dataset.as_ref(), &self.dataset)?,
        };
        let mut settings =
            dataset.metadata().map_or_else(Map::new, |Metadata { settings, .. }| settings.clone());
        settings.extend(self.env_option.clone());
        let config = EnvConfig { image: None, settings };
        let factors = entry.make(&config)?.spec().factors.clone();
        let overrides = factor_values(&self.set, entry, &factors, report)?;
        let name = self.dataset.display().to_string();
        let total = episodes.len() as u64;
        let progress = report.begin(&Stage { name: &name, role: None, unit: "episodes", total })?;
        let mut dataset = Watched::new(dataset, report.cancel());
        let watch = |_| progress.done(None);
        let work = || replay((entry, &config), &mut dataset, &episodes, &overrides, self.tolerance, watch);
        apart(report, || within(self.threads, work))??.map_err(|error| ended(error, report))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use swm_core::testing::TOY;

    use super::super::{Fix, Record};
    use super::*;

    fn ask(given: &Json) -> Result<ReplayReport, TaskError> {
        let registry = Registry::new().with(&[TOY]).with(swm_data::FORMATS);
        Replay::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, &mut ()))
    }

    fn recorded(out: PathBuf) -> PathBuf {
        let registry = Registry::new().with(&[TOY]).with(swm_data::FORMATS);
        let record = Record {
            env: TOY.id.to_owned(),
            episodes: Some(4),
            max_steps: 5,
            image_size: None,
            out: out.clone(),
            ..Record::default()
        };
        record.run(&registry, &mut ()).unwrap();
        out
    }

    #[test]
    fn every_refusal_names_the_setting_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let file = recorded(folder.path().join("a.h5"));
        for (given, text) in [
            (json!({}), "dataset: must be given"),
            (json!({ "dataset": file, "tolerance": -1 }), "tolerance=-1.0: use a number of 0 or more"),
            (json!({ "dataset": file, "threads": 0 }), "threads=0: use 1 to 1024"),
            (
                json!({ "dataset": file, "episodes": "4" }),
                "episodes=4: there is no episode 4; the dataset holds 4",
            ),
            (json!({ "dataset": file, "set": { "point.gian": 1 } }), "point.gian"),
            (json!({ "dataset": folder.path().join("none.h5") }), "none.h5"),
        ] {
            match ask(&given) {
                Err(error @ TaskError::Request(_)) => {
                    assert!(error.to_string().contains(text), "{text}: {error}");
                }
                other => panic!("{given}: {other:?}"),
            }
        }
        let unknown = ask(&json!({ "dataset": file, "env": "swm/Tyo-v0" })).unwrap_err();
        assert!(unknown.to_string().contains("swm/Toy-v0"), "{unknown}");
    }

    #[test]
    fn a_recording_is_what_the_simulator_does_and_changed_factors_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let file = recorded(folder.path().join("a.h5"));
        let same = ask(&json!({ "dataset": file, "tolerance": 0.0 })).unwrap();
        assert!(same.ok && same.episodes == 4 && same.rows > 4, "{same:?}");
        let some = ask(&json!({ "dataset": file, "episodes": "1..3", "threads": 2 })).unwrap();
        assert!(some.ok && some.episodes == 2 && some.rows < same.rows);
        let other = ask(&json!({ "dataset": file, "set": { "point.gain": 2.0 } })).unwrap();
        assert!(!other.ok && other.columns.values().any(|column| column.max_abs > 0.0), "{other:?}");
    }

    /// They changed nothing before: the environment of the replay had those of the dataset alone.
    #[test]
    fn settings_of_the_environment_are_those_that_are_given() {
        let folder = tempfile::tempdir().unwrap();
        let file = recorded(folder.path().join("a.h5"));
        let error = ask(&json!({ "dataset": file, "env_option": { "no_such": 1 } })).unwrap_err();
        assert!(error.to_string().contains("no_such"), "{error}");
    }

    #[test]
    fn a_dataset_of_an_unknown_environment_asks_for_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("other.h5");
        swm_data::testing::record(&file, swm_data::WriteMode::Error, 0..2).unwrap();
        let error = ask(&json!({ "dataset": file })).unwrap_err();
        assert!(error.to_string().contains("swm/Test-v1"), "{error}");
        assert!(matches!(error.fix(), Some(Fix::Set { setting, .. }) if setting.name == "env"), "{error}");
    }
}
