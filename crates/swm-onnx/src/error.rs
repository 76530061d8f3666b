//! Errors of exported models.

use std::path::{Path, PathBuf};

use swm_core::BoxError;
use swm_solvers::PlanError;
use thiserror::Error;

/// An exported model cannot be loaded, or does not fit.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OnnxError {
    /// ONNX Runtime is not there.
    #[error(
        "ONNX Runtime was not found: {reason}. Install it (pip install onnxruntime), or let ORT_DYLIB_PATH name \
         libonnxruntime.so"
    )]
    NoRuntime {
        /// What was tried.
        reason: String,
    },
    /// A file of the model cannot be used.
    #[error("model {}: {reason}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what the contract asks for.
        reason: String,
    },
    /// The environment does not fit the model.
    #[error("model input `{name}`: {reason}")]
    Input {
        /// The input.
        name: String,
        /// What is wrong, and what is expected.
        reason: String,
    },
    /// The model gave what is no cost.
    #[error("the model cannot be used: {reason}")]
    Output {
        /// The output, what is wrong with it, and what is expected.
        reason: String,
    },
    /// The model failed while it ran.
    #[error("the model failed: {0}")]
    Run(ort::Error),
}

impl OnnxError {
    /// A file of the model that is not there, or is not what it should be.
    pub(crate) fn unreadable(path: &Path, error: &dyn std::fmt::Display) -> Self {
        let reason =
            format!("{error}; `stable_worldmodel_rs.export` writes the files of a model, see docs/onnx.md");
        Self::Model { path: path.to_owned(), reason }
    }
}

impl From<OnnxError> for PlanError {
    fn from(error: OnnxError) -> Self {
        PlanError::Cost(BoxError::from(error))
    }
}
