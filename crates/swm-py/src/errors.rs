//! Errors of the core as Python exceptions.
//!
//! Every exception is a `SwmError`, which is a `ValueError`. An exception that was raised in Python code below the core
//! (a policy, a cost, a writer) comes out as itself, with its traceback.

use std::error::Error as StdError;
use std::io;

use pyo3::create_exception;
use pyo3::exceptions::{PyFileNotFoundError, PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;
use swm::core::{BatchError, DataError, EnvError, PolicyError, UnknownName, WorldError};
use swm::solvers::PlanError;
use swm::tasks::request::TaskError;

use crate::manifest::boxed;
use crate::words::{Arguments, in_python};

create_exception!(
    stable_worldmodel_rs,
    SwmError,
    PyValueError,
    "Whatever this package refuses; its message names the fix."
);
create_exception!(
    stable_worldmodel_rs,
    EnvironmentFault,
    SwmError,
    "An environment cannot be made, reset or stepped."
);
create_exception!(stable_worldmodel_rs, PolicyFault, SwmError, "A policy cannot be made or cannot act.");
create_exception!(stable_worldmodel_rs, DataFault, SwmError, "A dataset cannot be read or written.");
create_exception!(stable_worldmodel_rs, PlanFault, SwmError, "A solver or a cost refuses its input.");

/// Adds the exceptions, under the names by which Python knows them.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    m.add("SwmError", py.get_type::<SwmError>())?;
    for (name, class) in [
        ("EnvError", py.get_type::<EnvironmentFault>()),
        ("PolicyError", py.get_type::<PolicyFault>()),
        ("DataError", py.get_type::<DataFault>()),
        ("PlanError", py.get_type::<PlanFault>()),
    ] {
        class.setattr("__name__", name)?;
        class.setattr("__qualname__", name)?;
        m.add(name, class)?;
    }
    Ok(())
}

/// Makes a Python exception of an error of the core.
pub(crate) trait IntoPy {
    /// The exception; one that came from Python is itself again.
    fn into_py(self) -> PyErr;
}

/// `Result`s of the core, with `?` in mind: `core_call().or_raise()?`.
pub(crate) trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: IntoPy> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(IntoPy::into_py)
    }
}

/// The exception that lies at the bottom of an error, if Python code raised it.
fn raised(py: Python<'_>, error: &(dyn StdError + 'static)) -> Option<PyErr> {
    let mut next = Some(error);
    while let Some(error) = next {
        if let Some(raised) = error.downcast_ref::<PyErr>() {
            return Some(raised.clone_ref(py));
        }
        next = error.source();
    }
    None
}

/// Whether a file that does not exist is the reason.
fn is_missing(error: &(dyn StdError + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        if error.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::NotFound) {
            return true;
        }
        next = error.source();
    }
    false
}

/// The message with its causes, in words of Python.
fn message(error: &(dyn StdError + 'static)) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        next = cause.source();
    }
    in_python(&text)
}

impl IntoPy for WorldError {
    fn into_py(self) -> PyErr {
        Python::attach(|py| {
            if let Some(error) = self.foreign().and_then(|error| raised(py, error)) {
                return error;
            }
            match &self {
                Self::Cancelled | Self::Policy(PolicyError::Cancelled) => PyKeyboardInterrupt::new_err(()),
                Self::NoPolicy
                | Self::NoActions
                | Self::Actions { .. }
                | Self::Action { .. }
                | Self::Policy(_) => PolicyFault::new_err(message(&self)),
                Self::Record(_) | Self::Dataset(_) => self.foreign().map_or_else(
                    || DataFault::new_err(message(&self)),
                    |error| {
                        if is_missing(error) {
                            PyFileNotFoundError::new_err(message(&self))
                        } else {
                            DataFault::new_err(message(&self))
                        }
                    },
                ),
                _ => EnvironmentFault::new_err(message(&self)),
            }
        })
    }
}

/// Why a request of this name is not met, in words of Python.
pub(crate) fn in_words(error: TaskError, request: &'static str) -> PyErr {
    match error {
        TaskError::Request(message) => {
            SwmError::new_err(in_python(&message.in_words(&Arguments { request })))
        }
        error => boxed(error.into_source()),
    }
}

impl IntoPy for TaskError {
    fn into_py(self) -> PyErr {
        in_words(self, "")
    }
}

impl IntoPy for PolicyError {
    fn into_py(self) -> PyErr {
        WorldError::Policy(self).into_py()
    }
}

impl IntoPy for EnvError {
    fn into_py(self) -> PyErr {
        EnvironmentFault::new_err(message(&self))
    }
}

impl IntoPy for BatchError {
    fn into_py(self) -> PyErr {
        SwmError::new_err(message(&self))
    }
}

impl IntoPy for DataError {
    fn into_py(self) -> PyErr {
        Python::attach(|py| {
            if let Some(error) = raised(py, &self) {
                return error;
            }
            if is_missing(&self) {
                PyFileNotFoundError::new_err(message(&self))
            } else {
                DataFault::new_err(message(&self))
            }
        })
    }
}

impl IntoPy for PlanError {
    fn into_py(self) -> PyErr {
        Python::attach(|py| match self.foreign().and_then(|error| raised(py, error)) {
            Some(error) => error,
            None if matches!(self, Self::Cancelled) => PyKeyboardInterrupt::new_err(()),
            None => PlanFault::new_err(message(&self)),
        })
    }
}

impl IntoPy for UnknownName {
    /// `gymnasium.error.NameNotFound` for environments, so that `gymnasium.make` and ours fail alike.
    fn into_py(self) -> PyErr {
        let text = in_python(&self.to_string());
        if self.kind != "environment" {
            return SwmError::new_err(text);
        }
        Python::attach(|py| {
            let class = py.import("gymnasium.error").and_then(|errors| errors.getattr("NameNotFound"));
            match class.and_then(|class| class.call1((text,))) {
                Ok(error) => PyErr::from_value(error),
                Err(error) => error,
            }
        })
    }
}
