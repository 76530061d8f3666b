//! Published results, repeated. Every wheel has them, as they take trained models.

use pyo3::prelude::*;

use crate::report::Made;

/// The recipes that there are as JSON.
#[pyfunction]
fn recipes() -> PyResult<String> {
    work::recipes()
}

/// Repeats a published result: `request` is a JSON object of the settings of `Reproduce`. `begin` is called with what each progress bar is
/// called and its length. Gives what came out beside what was reported as JSON, and notes.
#[pyfunction]
#[pyo3(signature = (request, begin=None, tick=None))]
fn reproduce(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made {
    work::reproduce(py, request, begin, tick)
}

#[cfg(feature = "baselines")]
mod work {
    use pyo3::prelude::*;
    use swm::checkpoints::reproduce::{Reproduce, recipes as all};

    use crate::manifest::to_json;
    use crate::report::{Made, run};

    pub(super) fn recipes() -> PyResult<String> {
        to_json(&all())
    }

    pub(super) fn reproduce(
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

    pub(super) fn reproduce(
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
    m.add_function(wrap_pyfunction!(reproduce, m)?)
}
