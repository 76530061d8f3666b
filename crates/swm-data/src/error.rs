//! Errors of datasets: the core's [`DataError`], and [`FormatError`] for what a format finds wrong inside a file.

use std::borrow::Cow;
use std::{fmt, io};

use swm_core::BatchError;
use swm_core::error::BoxError;
use swm_media::MediaError;
use thiserror::Error;

pub use swm_core::dataset::{DataError, NotBuiltIn};

pub use crate::guarded::guarded;

/// What is wrong inside a file of a format, or with rows that are to be stored in it. The [`DataError`] around it names
/// the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FormatError {
    /// A file, column, record or value that must exist does not.
    #[error("{0}")]
    Missing(Cow<'static, str>),
    /// The element type or the shape differs from the expected one.
    #[error("{0}")]
    WrongType(Cow<'static, str>),
    /// A value, size or order is impossible or contradicts another part, or a part is truncated.
    #[error("{0}")]
    Invalid(Cow<'static, str>),
    /// The content may be valid, but this program does not support it.
    #[error("{0}")]
    Unsupported(#[source] NotBuiltIn),
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// Another crate refused, such as a codec.
    #[error("{0}")]
    Other(#[source] BoxError),
    /// One of the above, in one part of the file.
    #[error("{place}: {source}")]
    At {
        /// The part: a column, a row, a file of a folder.
        place: String,
        /// What is wrong there.
        source: Box<Self>,
    },
}

/// Of a format's functions.
pub type Result<T, E = FormatError> = std::result::Result<T, E>;

impl FormatError {
    /// The error of another crate.
    pub fn other(error: impl Into<BoxError>) -> Self {
        Self::Other(error.into())
    }

    /// The same, in this part of the file.
    #[must_use]
    pub fn at(self, place: impl fmt::Display) -> Self {
        Self::At { place: place.to_string(), source: Box::new(self) }
    }

    /// Whether this program lacks something, rather than the file.
    pub fn is_unsupported(&self) -> bool {
        match self {
            Self::Unsupported(_) => true,
            Self::At { source, .. } => source.is_unsupported(),
            _ => false,
        }
    }
}

/// [`FormatError::Missing`] with this message.
pub fn missing(message: impl Into<Cow<'static, str>>) -> FormatError {
    FormatError::Missing(message.into())
}

/// [`FormatError::WrongType`] with this message.
pub fn wrong_type(message: impl Into<Cow<'static, str>>) -> FormatError {
    FormatError::WrongType(message.into())
}

/// [`FormatError::Invalid`] with this message.
pub fn invalid(message: impl Into<Cow<'static, str>>) -> FormatError {
    FormatError::Invalid(message.into())
}

/// [`FormatError::Unsupported`] with this message.
pub fn unsupported(message: impl Into<Cow<'static, str>>) -> FormatError {
    FormatError::Unsupported(NotBuiltIn(message.into()))
}

macro_rules! from {
    ($($error:ty),+) => {
        $(impl From<$error> for FormatError {
            fn from(error: $error) -> Self {
                Self::other(error)
            }
        })+
    };
}

from!(BatchError, DataError, serde_json::Error);

impl From<MediaError> for FormatError {
    fn from(error: MediaError) -> Self {
        match error {
            MediaError::Unsupported { .. } => unsupported(error.to_string()),
            error => Self::other(error),
        }
    }
}

/// Adds to an error where in the file it arose.
pub trait At<T> {
    /// Names the part of the file, as in `column x: …`.
    ///
    /// # Errors
    ///
    /// [`FormatError::At`] around the error, if it is one.
    fn at(self, place: impl fmt::Display) -> Result<T>;
}

impl<T, E: Into<FormatError>> At<T> for Result<T, E> {
    fn at(self, place: impl fmt::Display) -> Result<T> {
        self.map_err(|error| error.into().at(place))
    }
}
