//! What a dataset holds.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::ser::SerializeMap as _;
use serde::{Serialize, Serializer};
use serde_json::json;
use swm_core::{Field, Metadata, Registry};
use swm_data::OpenOptions;

use super::copies::check_exists;
use super::{Report, Request, TaskError, apart, must_be_given, open_dataset_with, wrong};

swm_core::settings! {
    /// Show format, episodes, columns and metadata of a dataset.
    pub struct Inspect {
        /// The dataset.
        dataset: PathBuf = PathBuf::new() => "must be given",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
    }
}

/// What a dataset holds.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Inspection {
    /// The name of its format.
    pub format: &'static str,
    /// How many episodes it has.
    pub episodes: usize,
    /// Rows of all of them.
    pub steps: usize,
    /// The columns.
    #[serde(serialize_with = "by_name")]
    pub columns: Vec<Field>,
    /// Rows of the shortest and of the longest episode.
    pub episode_lengths: Extremes,
    /// How the first episode was made.
    pub metadata: Option<Metadata>,
    /// The runs that recorded it.
    pub runs: Vec<RecordingRun>,
    /// Columns that are left out, with the reason.
    pub skipped: Vec<(String, String)>,
    /// For columns of a dataset of another program, the names in its files.
    pub mapping: BTreeMap<String, String>,
    /// What a user has to know about it.
    pub notes: Vec<String>,
    /// Rows between two stored states, of a dataset that can be rendered again.
    pub checkpoint_rows: Option<u32>,
}

/// The least and the greatest of some numbers; `None`: there are none.
#[derive(Clone, Copy, Debug, Serialize)]
#[non_exhaustive]
pub struct Extremes {
    /// The least.
    pub min: Option<usize>,
    /// The greatest.
    pub max: Option<usize>,
}

/// A run that recorded episodes of a dataset.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct RecordingRun {
    /// The first of them.
    pub first_episode: u64,
    /// How they were made.
    pub metadata: Metadata,
}

fn by_name<S: Serializer>(columns: &[Field], serializer: S) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(columns.len()))?;
    for field in columns {
        map.serialize_entry(&field.name, &json!({ "dtype": field.dtype.name(), "shape": field.shape }))?;
    }
    map.end()
}

impl Request for Inspect {
    const NAME: &'static str = "inspect";
    type Outcome = Inspection;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("dataset", self.dataset.as_os_str().is_empty())])?;
        self.opening.check().map_err(wrong)?;
        check_exists(&self.dataset)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Inspection, TaskError> {
        self.check(registry)?;
        let dataset = apart(report, || open_dataset_with(registry, &self.dataset, &self.opening))??;
        let (info, metadata) = (dataset.info(), dataset.metadata());
        let lengths = &info.lengths;
        let runs = info.runs.iter();
        Ok(Inspection {
            format: info.format,
            episodes: lengths.len(),
            steps: lengths.iter().sum(),
            columns: info.schema.fields().to_vec(),
            episode_lengths: Extremes {
                min: lengths.iter().min().copied(),
                max: lengths.iter().max().copied(),
            },
            metadata: metadata.cloned(),
            runs: runs
                .map(|(first, run)| RecordingRun { first_episode: *first, metadata: run.clone() })
                .collect(),
            skipped: info.skipped.to_vec(),
            mapping: info.mapping.iter().cloned().collect(),
            notes: info.notes.to_vec(),
            checkpoint_rows: metadata.and_then(|metadata| metadata.checkpoints),
        })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};
    use swm_core::testing::TOY;

    use super::super::Record;
    use super::*;

    #[test]
    fn what_a_dataset_holds_is_found_and_a_wrong_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let registry = Registry::new().with(&[TOY]).with(swm_data::FORMATS);
        let ask = |given: &Json| {
            Inspect::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, &mut ()))
        };
        let data = folder.path().join("a.h5");
        let record = Record {
            env: TOY.id.to_owned(),
            episodes: Some(3),
            max_steps: 4,
            out: data.clone(),
            ..Record::default()
        };
        record.run(&registry, &mut ()).unwrap();
        let found = ask(&json!({ "dataset": data })).unwrap();
        assert_eq!((found.format, found.episodes, found.runs.len()), ("hdf5", 3, 1));
        assert!(found.episode_lengths.max.unwrap() <= 5 && found.metadata.unwrap().env == TOY.id);
        assert!(found.columns.iter().any(|field| field.name == "action"));
        for (given, text) in [
            (json!({}), "dataset: must be given"),
            (json!({ "dataset": folder.path().join("none.h5") }), "none.h5"),
            (json!({ "dataset": data, "opening": { "camera": "wrist" } }), "camera"),
        ] {
            let error = ask(&given).unwrap_err().to_string();
            assert!(error.contains(text), "{text}: {error}");
        }
    }
}
