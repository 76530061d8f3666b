//! Published checkpoints and results. Every wheel has them, as they take trained models.

use pyo3::prelude::*;

pub(crate) use work::reproduce;

/// The recipes that there are as JSON.
#[pyfunction]
fn recipes() -> PyResult<String> {
    work::recipes()
}

/// A config that Hydra wrote, as JSON.
#[pyfunction]
fn yaml_config(text: &str) -> PyResult<String> {
    work::yaml_config(text)
}

#[cfg(feature = "baselines")]
mod work {
    use pyo3::exceptions::PyValueError;
    use pyo3::prelude::*;
    use swm::checkpoints::import::read_yaml;
    use swm::checkpoints::reproduce::{Reproduce, recipes as all};

    use crate::manifest::to_json;
    use crate::report::{Made, run};

    pub(super) fn recipes() -> PyResult<String> {
        to_json(&all())
    }

    pub(super) fn yaml_config(text: &str) -> PyResult<String> {
        to_json(&read_yaml(text).map_err(PyValueError::new_err)?)
    }

    /// Repeats a published result: what came out beside what was reported.
    pub(crate) fn reproduce(
        py: Python<'_>,
        request: &str,
        begin: Option<&Bound<'_, PyAny>>,
        tick: Option<&Bound<'_, PyAny>>,
    ) -> Made {
        run::<Reproduce>(py, request, begin, tick)
    }
}

#[cfg(not(feature = "baselines"))]
mod work {
    use pyo3::prelude::*;

    use crate::errors::SwmError;
    use crate::report::Made;

    fn absent() -> PyErr {
        SwmError::new_err(
            "this package is built without the feature `baselines`, which every wheel has; install one, or build it in a checkout by `cargo \
             xtask wheel`",
        )
    }

    pub(super) fn recipes() -> PyResult<String> {
        Err(absent())
    }

    pub(super) fn yaml_config(_text: &str) -> PyResult<String> {
        Err(absent())
    }

    pub(crate) fn reproduce(
        _py: Python<'_>,
        _request: &str,
        _begin: Option<&Bound<'_, PyAny>>,
        _tick: Option<&Bound<'_, PyAny>>,
    ) -> Made {
        Err(absent())
    }
}

/// Adds this file's functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(recipes, m)?)?;
    m.add_function(wrap_pyfunction!(yaml_config, m)?)
}
