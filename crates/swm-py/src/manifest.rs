//! Manifests: made and read. Runs on them are in `runs`.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::core::error::BoxError;
use swm::core::evaluate::is_held_out;
use swm::core::{DataError, EnvError, PolicyError, UnknownName, WorldError};
use swm::evaluation::read_manifest;
use swm::tasks::request::{MakeManifest, Message, Request as _, TaskError};

use crate::errors::{IntoPy, OrRaise as _, SwmError};
use crate::words::{Arguments, in_python};
use crate::world::registry;

/// An error of any kind as the exception that it is.
pub(crate) fn boxed(error: BoxError) -> PyErr {
    fn of<E: IntoPy + std::error::Error + 'static>(error: BoxError) -> Result<PyErr, BoxError> {
        error.downcast::<E>().map(|error| (*error).into_py())
    }
    let known = of::<WorldError>(error)
        .or_else(of::<PolicyError>)
        .or_else(of::<EnvError>)
        .or_else(of::<DataError>)
        .or_else(of::<UnknownName>)
        .or_else(of::<TaskError>);
    let error = match known {
        Ok(error) => return error,
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
    let manifest = read_manifest(&path).or_raise()?;
    Ok((to_json(&manifest)?, manifest.hash()))
}

/// Makes a manifest and writes it. `request`: a JSON object of the settings of `MakeManifest`. Gives the manifest as JSON, its
/// hash, and notes.
#[pyfunction]
fn make_manifest(py: Python<'_>, request: &str) -> PyResult<(String, String, Vec<String>)> {
    let request = MakeManifest::from_json(&from_json("the request", request)?).or_raise()?;
    let mut notes: Vec<Message> = Vec::new();
    let manifest = py.detach(|| request.run(registry(), &mut notes)).or_raise()?;
    let notes = notes.iter().map(|note| note.in_words(&Arguments::default())).collect();
    Ok((to_json(&manifest)?, manifest.hash(), notes))
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
