//! Why a task is not done. Functions of this crate return [`TaskError`], or [`FileError`] where nothing but a file can fail.

use std::path::{Path, PathBuf};
use std::{fmt, io};

use swm_core::error::BoxError;
use swm_core::{BatchError, DataError, EnvError, PolicyError, UnknownName, WorldError};
use swm_solvers::PlanError;

use crate::request::{Fix, Message};

/// A file or folder cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {source}", .path.display())]
pub struct FileError {
    /// What was tried: `read`, `make the folder`.
    pub action: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// The system's reason.
    pub source: io::Error,
}

/// What makes a [`FileError`] of the system's reason: `fs::read(path).map_err(cannot("read", path))`.
pub fn cannot(action: &'static str, path: &Path) -> impl Fn(io::Error) -> FileError + Copy {
    move |source| FileError { action, path: path.to_owned(), source }
}

/// Why a request is not met.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The request is wrong.
    #[error("{0}")]
    Request(Box<Message>),
    /// A run of environments and policies failed, or was cancelled.
    #[error(transparent)]
    World(#[from] WorldError),
    /// An environment cannot be made, reset or stepped.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// A policy cannot be made or cannot act.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A field or value is wrong.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// A dataset cannot be read or written.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A planner cannot be made or cannot plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No table has this name.
    #[error(transparent)]
    Name(#[from] UnknownName),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// What a file, a result or a model holds does not fit, for this reason.
    #[error("{0}")]
    Unfit(String),
    /// Any other error, of a plugin, a front end or a library.
    #[error(transparent)]
    Failed(BoxError),
}

impl TaskError {
    /// What helps, where it is known.
    pub fn fix(&self) -> Option<&Fix> {
        match self {
            Self::Request(message) => message.fix.as_ref(),
            _ => None,
        }
    }
}

impl From<Message> for TaskError {
    fn from(message: Message) -> Self {
        Self::Request(Box::new(message))
    }
}

impl From<String> for TaskError {
    fn from(reason: String) -> Self {
        Self::Unfit(reason)
    }
}

impl From<&str> for TaskError {
    fn from(reason: &str) -> Self {
        Self::Unfit(reason.to_owned())
    }
}

/// A wrong request, in the words of its reason.
pub(crate) fn wrong(reason: impl fmt::Display) -> TaskError {
    Message::new(reason.to_string()).into()
}

/// Errors that are variants, each of its type.
macro_rules! variants {
    ($($name:ident: $error:ty,)*) => {
        /// An error that was boxed on its way is itself again.
        impl From<BoxError> for TaskError {
            fn from(error: BoxError) -> Self {
                let error = match error.downcast::<Self>() {
                    Ok(error) => return *error,
                    Err(error) => error,
                };
                $(let error = match error.downcast::<$error>() {
                    Ok(error) => return Self::$name(*error),
                    Err(error) => error,
                };)*
                Self::Failed(error)
            }
        }

        impl TaskError {
            /// The error within: of the core, of a file, a plugin or a library.
            pub fn into_source(self) -> BoxError {
                match self {
                    $(Self::$name(error) => error.into(),)*
                    Self::Unfit(reason) => reason.into(),
                    Self::Request(message) => message.to_string().into(),
                    Self::Failed(error) => error,
                }
            }
        }
    };
}

variants! {
    World: WorldError,
    Env: EnvError,
    Policy: PolicyError,
    Batch: BatchError,
    Data: DataError,
    Plan: PlanError,
    Name: UnknownName,
    File: FileError,
}

/// Errors of libraries that are met here.
macro_rules! foreign {
    ($($error:ty,)*) => {
        $(impl From<$error> for TaskError {
            fn from(error: $error) -> Self {
                Self::Failed(error.into())
            }
        })*
    };
}

foreign! {
    io::Error,
    minijinja::Error,
    serde_json::Error,
    std::num::TryFromIntError,
    swm_media::MediaError,
    toml::de::Error,
    toml::ser::Error,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_was_boxed_is_itself_again() {
        assert!(size_of::<TaskError>() < 128, "results with larger errors are slow to return");
        let boxed: BoxError = WorldError::Cancelled.into();
        assert!(matches!(TaskError::from(boxed), TaskError::World(WorldError::Cancelled)));
        let boxed: BoxError = TaskError::from(Message::about("seed", 1, "is taken")).into();
        let TaskError::Request(message) = TaskError::from(boxed) else { panic!("it is a request") };
        assert_eq!(message.to_string(), "seed=1: is taken");
        let source = TaskError::from(WorldError::Cancelled).into_source();
        assert!(source.is::<WorldError>(), "{source}");
    }

    #[test]
    fn a_file_is_named_with_what_was_tried_and_keeps_the_systems_error() {
        let error = cannot("read", Path::new("a.toml"))(io::ErrorKind::NotFound.into());
        assert!(error.to_string().starts_with("cannot read a.toml: "), "{error}");
        let error = TaskError::from(error);
        let source = std::error::Error::source(&error).and_then(|source| source.downcast_ref::<io::Error>());
        assert_eq!(source.map(io::Error::kind), Some(io::ErrorKind::NotFound));
    }
}
