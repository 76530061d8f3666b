//! What can go wrong with objects that lie elsewhere. No error holds a credential: objects are named without the query of their address.

use std::error::Error;
use std::io;
use std::path::Path;

use swm_core::dataset::DataError;
use thiserror::Error as ThisError;

/// Why an object was not read.
#[derive(Clone, Debug, ThisError)]
#[error("{reason}; {fix}")]
#[non_exhaustive]
pub struct RemoteError {
    /// The object: its address, without a query.
    pub name: String,
    /// What kind of failure it is.
    pub kind: RemoteErrorKind,
    /// What went wrong.
    pub reason: String,
    /// What to do.
    pub fix: String,
}

/// Kinds of failures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RemoteErrorKind {
    /// The address is none.
    Address,
    /// Nothing is there.
    Missing,
    /// It may not be read.
    Denied,
    /// It is another version than the one that was opened.
    Changed,
    /// The server answers in a way that it should not.
    Answer,
    /// There is no connection, or it ends, again and again.
    Network,
    /// The folder of fetched data cannot be written to.
    Cache,
}

impl RemoteError {
    pub(super) fn new(
        kind: RemoteErrorKind,
        name: &str,
        reason: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self { name: name.to_owned(), kind, reason: reason.into(), fix: fix.into() }
    }

    /// The folder of fetched data cannot be written to.
    pub(super) fn cache(name: &str, path: &Path, error: &io::Error) -> Self {
        let reason = format!("cannot write {}: {error}", path.display());
        Self::new(RemoteErrorKind::Cache, name, reason, "free some space, or set SWM_CACHE to another folder")
    }

    /// The error of a dataset, when this was tried.
    #[must_use]
    pub fn while_trying(self, action: &'static str) -> DataError {
        DataError::io(Path::new(&self.name.clone()), action, self.into())
    }

    /// This error among the sources of another.
    pub(super) fn within<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a Self> {
        let mut next = Some(error);
        while let Some(error) = next {
            let inner = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
            let inner = inner.map(|inner| inner as &(dyn Error + 'static));
            if let Some(found) = error.downcast_ref().or_else(|| inner?.downcast_ref()) {
                return Some(found);
            }
            next = inner.and_then(Error::source).or_else(|| error.source());
        }
        None
    }

    /// An error of a reader, in which a failure of the network is no damage.
    #[must_use]
    pub fn or_damage(error: DataError, action: &'static str) -> DataError {
        match Self::within(&error) {
            Some(found) => found.clone().while_trying(action),
            None => error,
        }
    }
}

impl From<RemoteError> for io::Error {
    fn from(error: RemoteError) -> Self {
        let kind = match error.kind {
            RemoteErrorKind::Address => io::ErrorKind::InvalidInput,
            RemoteErrorKind::Missing => io::ErrorKind::NotFound,
            RemoteErrorKind::Denied => io::ErrorKind::PermissionDenied,
            _ => io::ErrorKind::Other,
        };
        Self::new(kind, error)
    }
}
