//! The zoo: trained models that are shipped, by name.

use std::path::PathBuf;

use pyo3::prelude::*;
use swm::tasks::zoo::{self, ZooModel};

use crate::errors::OrRaise as _;
use crate::manifest::to_json;

/// All models of the zoo as JSON, and why some are left out.
#[pyfunction]
fn zoo_models(py: Python<'_>) -> PyResult<(String, Vec<String>)> {
    let (mut models, mut notes) = (Vec::new(), Vec::new());
    for (name, folder) in zoo::all() {
        match py.detach(|| ZooModel::open(&folder)) {
            Ok(model) => models.push(model),
            Err(reason) => notes.push(format!("zoo:{name} is left out: {reason}")),
        }
    }
    Ok((to_json(&models)?, notes))
}

/// A model of the zoo as JSON, after a comparison of the hashes of its files.
#[pyfunction]
fn zoo_model(py: Python<'_>, name: &str) -> PyResult<String> {
    let model = py.detach(|| zoo::find(name).and_then(|folder| ZooModel::open(&folder))).or_raise()?;
    to_json(&model)
}

/// Says in which folders models of the zoo are, and what errors advise where there is none.
#[pyfunction]
fn set_zoo(folders: Vec<PathBuf>, advice: String) {
    folders.into_iter().for_each(zoo::add_folder);
    zoo::set_advice(advice);
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(zoo_models, m)?)?;
    m.add_function(wrap_pyfunction!(zoo_model, m)?)?;
    m.add_function(wrap_pyfunction!(set_zoo, m)?)
}
