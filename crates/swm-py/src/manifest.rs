//! Manifests: made and read. Runs on them are in `runs`.

use std::path::PathBuf;

use pyo3::prelude::*;
use serde::Deserialize;
use swm::core::error::BoxError;
use swm::core::evaluate::{ChosenPair, ManifestOptions, is_held_out, make_manifest as make};
use swm::core::{EnvConfig, ImageSize, PolicyError, ResetOptions, WorldError};
use swm::evaluation::{holds_manifest, read_manifest, recorded_pairs, tier_rules, write_manifest};

use crate::errors::{IntoPy as _, OrRaise as _, SwmError};
use crate::infos;
use crate::words::in_python;
use crate::world::registry;

/// An error of any kind as the exception that it is.
pub(crate) fn boxed(error: BoxError) -> PyErr {
    let error = match error.downcast::<WorldError>() {
        Ok(error) => return error.into_py(),
        Err(error) => error,
    };
    let error = match error.downcast::<PolicyError>() {
        Ok(error) => return error.into_py(),
        Err(error) => error,
    };
    match error.downcast::<PyErr>() {
        Ok(error) => *error,
        Err(error) => SwmError::new_err(in_python(&error.to_string())),
    }
}

/// A value as JSON.
pub(crate) fn to_json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| SwmError::new_err(error.to_string()))
}

/// JSON as a value; `what` names it in errors.
pub(crate) fn from_json<T: serde::de::DeserializeOwned>(what: &str, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|error| SwmError::new_err(format!("{what}: {error}")))
}

/// A manifest file as JSON, and its hash.
#[pyfunction]
fn manifest_json(path: PathBuf) -> PyResult<(String, String)> {
    let manifest = read_manifest(&path).map_err(boxed)?;
    Ok((to_json(&manifest)?, manifest.hash()))
}

/// Makes a manifest and writes it to `path`; gives its JSON and hash, and which factors are not sampled as they are by
/// default. Unless `overwrite`, a file that holds something else is refused. `options`: a JSON object with `env`, `settings`, `tier`, `episodes`, `budget`, `frame_skip`, `image`, `seed`,
/// `distractors`, `vary`, `pairs`. `dataset`: path, goal offset, held-out share.
#[pyfunction]
#[pyo3(signature = (path, options, set=None, dataset=None, overwrite=false))]
fn make_manifest(
    py: Python<'_>,
    path: PathBuf,
    options: &str,
    set: Option<&Bound<'_, PyAny>>,
    dataset: Option<(PathBuf, usize, f64)>,
    overwrite: bool,
) -> PyResult<(String, String, Vec<String>)> {
    let asked: serde_json::Value = from_json("the options of the manifest", options)?;
    let get = |name: &str| asked.get(name).cloned().unwrap_or_default();
    let entry = registry().env(get("env").as_str().unwrap_or_default()).or_raise()?;
    let parsed = |name: &str, error: serde_json::Error| SwmError::new_err(format!("{name}: {error}"));
    let tier = serde_json::from_value(get("tier")).map_err(|error| parsed("tier", error))?;
    let image: Option<(usize, usize)> =
        serde_json::from_value(get("image")).map_err(|error| parsed("image_shape", error))?;
    let image = image.map(|(height, width)| ImageSize { height, width });
    let mut source =
        dataset.as_ref().map(|(path, ..)| swm::data::open_in(registry(), path)).transpose().or_raise()?;
    let recorded = source.as_ref().and_then(|source| source.metadata()).cloned();
    let mut settings =
        recorded.as_ref().map_or_else(serde_json::Map::new, |recorded| recorded.settings.clone());
    settings.extend(get("settings").as_object().cloned().unwrap_or_default());
    let rules = tier_rules(entry.id, &settings, tier).map_err(SwmError::new_err)?;
    let distractors: Vec<String> =
        serde_json::from_value(get("distractors")).map_err(|error| parsed("distractors", error))?;
    swm::distractors::parse_all(&distractors).map_err(|error| SwmError::new_err(error.to_string()))?;
    let chosen: Option<Vec<String>> =
        serde_json::from_value(get("pairs")).map_err(|error| parsed("pairs", error))?;
    let chosen: Option<Vec<ChosenPair>> = chosen
        .map(|pairs| pairs.iter().map(|text| text.parse()).collect::<Result<_, String>>())
        .transpose()
        .map_err(|reason| SwmError::new_err(format!("pairs: {reason}")))?;
    let config = EnvConfig { image, settings };
    let spec = entry.make(&config).or_raise()?.spec().clone();
    let options = ManifestOptions {
        tier,
        pairs: count(&asked, "episodes")?.unwrap_or(100),
        budget: count(&asked, "budget")?.unwrap_or(if dataset.is_some() { 50 } else { 200 }),
        frame_skip: count(&asked, "frame_skip")?
            .or(recorded.map(|recorded| recorded.frame_skip))
            .unwrap_or(1),
        image,
        seed: count(&asked, "seed")?.unwrap_or(42),
        distractors,
        vary: serde_json::from_value(get("vary")).map_err(|error| parsed("variation", error))?,
        set: set.map(|set| infos::factors(&spec, set)).transpose()?.unwrap_or_default(),
        success: rules.success,
        motion: rules.motion,
        rest: rules.rest,
    };
    let reset = ResetOptions {
        variation: options.vary.clone(),
        variation_values: options.set.clone(),
        ..ResetOptions::default()
    };
    // A dataset has its starts already.
    let factors = if dataset.is_none() { spec.factors.as_slice() } else { &[] };
    let unsampled = reset.unsampled_defaults(factors).into_iter().map(str::to_owned).collect();
    let manifest = py.detach(|| {
        let pairs = match (&mut source, &dataset) {
            (Some(source), Some((path, goal_offset, held_out))) => {
                let mut recorded = recorded_pairs(source, path).map_err(boxed)?;
                recorded.goal_offset = *goal_offset;
                recorded.held_out = *held_out;
                recorded.chosen.clone_from(&chosen);
                Some(recorded)
            }
            _ => None,
        };
        make(entry, &config, &options, pairs).or_raise()
    })?;
    if overwrite || !holds_manifest(&path, &manifest).map_err(boxed)? {
        write_manifest(&path, &manifest).map_err(boxed)?;
    }
    Ok((to_json(&manifest)?, manifest.hash(), unsampled))
}

/// An option that counts something; nothing where none is given.
fn count<'de, T: Deserialize<'de>>(asked: &'de serde_json::Value, name: &str) -> PyResult<Option<T>> {
    let told = &asked[name];
    Option::deserialize(told).map_err(|_| {
        SwmError::new_err(format!("{name}: {told} is not a whole number from 0 on, or too large"))
    })
}

/// Of these episodes of a dataset, which are held out from training (see `swm_core::evaluate::is_held_out`).
#[pyfunction]
fn held_out(episodes: Vec<usize>, share: f64) -> Vec<bool> {
    episodes.into_iter().map(|episode| is_held_out(episode, share)).collect()
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(manifest_json, m)?)?;
    m.add_function(wrap_pyfunction!(held_out, m)?)?;
    m.add_function(wrap_pyfunction!(make_manifest, m)?)
}
