//! What can go wrong with a file of weights.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A file of weights cannot be read or written.
#[derive(Debug, Error)]
pub enum WeightsError {
    /// What is in the file, or the file itself, is of no use.
    #[error("weights in `{}`: {reason}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The operating system refused to write it.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

impl WeightsError {
    /// A file that cannot be used.
    pub(crate) fn unusable(path: &Path, reason: impl Into<String>) -> Self {
        Self::Unusable { path: path.to_owned(), reason: reason.into() }
    }
}
