//! What is wrong with a table, or missing in this reader.

use std::borrow::Cow;
use std::{fmt, io};

use thiserror::Error;

/// Why a table, or rows of it, cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LanceError {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// A length, position or value contradicts another part of the table.
    #[error("{0}")]
    Damaged(Cow<'static, str>),
    /// The table may be valid, but this reader does not support this part of the format.
    #[error("{0}")]
    Unsupported(Cow<'static, str>),
    /// One of the above, in one part of the table.
    #[error("{place}: {source}")]
    At {
        /// The part: a file, a column, a page.
        place: String,
        /// What is wrong there.
        source: Box<Self>,
    },
}

/// Of the functions of this crate.
pub(crate) type Result<T, E = LanceError> = std::result::Result<T, E>;

impl LanceError {
    /// Whether this reader lacks something, rather than the table.
    pub fn is_unsupported(&self) -> bool {
        match self {
            Self::Unsupported(_) => true,
            Self::At { source, .. } => source.is_unsupported(),
            _ => false,
        }
    }
}

pub(crate) fn damaged(message: impl Into<Cow<'static, str>>) -> LanceError {
    LanceError::Damaged(message.into())
}

pub(crate) fn unsupported(message: impl Into<Cow<'static, str>>) -> LanceError {
    LanceError::Unsupported(message.into())
}

/// Adds to an error where in the table it arose.
pub(crate) trait At<T> {
    fn at(self, place: impl fmt::Display) -> Result<T>;
}

impl<T, E: Into<LanceError>> At<T> for Result<T, E> {
    fn at(self, place: impl fmt::Display) -> Result<T> {
        self.map_err(|error| LanceError::At { place: place.to_string(), source: Box::new(error.into()) })
    }
}
