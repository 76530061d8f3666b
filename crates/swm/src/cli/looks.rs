//! Looks of recordings: which visual factors are set where images are rendered when they are read.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json};
use swm_core::{EnvConfig, Metadata, Registry, Value};
use swm_data::Dataset;
use swm_data::rendered::env_named;
use swm_tasks::request::{self, TaskError};

use super::args::assignment;
use super::{Failure, Output, usage};

/// The values of an option `NAME=VALUE` that is about factors of the environment of a recording.
pub(super) fn values(
    dataset: &dyn Dataset,
    registry: &Registry,
    (option, given): (&str, &[String]),
    output: &Output,
) -> Result<BTreeMap<String, Value>, Failure> {
    if given.is_empty() {
        return Ok(BTreeMap::new());
    }
    let path = dataset.path().display();
    let Some(metadata) = dataset.metadata().and_then(Metadata::of_known_env) else {
        return Err(usage(format!(
            "{option} {}: {path} does not say how it was recorded, so that its images cannot be rendered anew; leave it out",
            given[0]
        )));
    };
    let entry = env_named(registry, &metadata.env, &format!("{path} was recorded in")).map_err(usage)?;
    let config = EnvConfig { image: None, settings: metadata.settings.clone() };
    let factors = entry.make(&config).map_err(usage)?.spec().factors.clone();
    let mut set = Map::new();
    for one in given {
        let (name, text) = assignment(one, option)?;
        set.insert(name.to_owned(), Json::from(text));
    }
    request::factor_values(&set, entry, &factors, &mut &*output).map_err(|error| match error {
        TaskError::Request(message) => usage(format!("{option}: {}", message.text)),
        error => error.into(),
    })
}
