//! What can go wrong with a dataset. Every message names the file, the reason and the fix.

use std::borrow::Cow;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::{io, iter};

use thiserror::Error as ThisError;

use crate::error::{BoxError, did_you_mean};

/// A dataset cannot be opened, read, written or windowed.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum DataError {
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The file is no dataset that any format knows.
    #[error("{} is not a dataset: {reason}", .path.display())]
    NotADataset {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// The file is a dataset, but a part of it is missing or contradicts another.
    #[error("{} is damaged: {}{reason}", .path.display(), part(.column.as_deref(), *.episode))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The damaged column, if it is one.
        column: Option<String>,
        /// The damaged episode, if it is one.
        episode: Option<usize>,
        /// What is wrong there.
        #[source]
        reason: BoxError,
    },
    /// A valid part that this program does not read: nothing is wrong with the file.
    #[error("cannot read {}: {}{reason}", .path.display(), part(.column.as_deref(), *.episode))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The column that is not read, if it is one.
        column: Option<String>,
        /// The episode that is not read, if it is one.
        episode: Option<usize>,
        /// What is not read, and what to do.
        #[source]
        reason: BoxError,
    },
    /// No format has this name or file extension.
    #[error("{}; known formats: {known}{}{hint}", no_format(.name), did_you_mean(.nearest.as_deref()))]
    UnknownFormat {
        /// The name asked for.
        name: String,
        /// The nearest existing one.
        nearest: Option<String>,
        /// All of them, with their extensions.
        known: String,
        /// What brings a format that this build lacks, from `; ` on; else empty.
        hint: String,
    },
    /// A format was to be registered under a name that another one has.
    #[error(
        "the dataset format `{name}` cannot be registered: `{known}` has its name or file extension already"
    )]
    FormatTaken {
        /// The new one.
        name: &'static str,
        /// The one that is there.
        known: &'static str,
    },
    /// The file is there and the mode is `error`.
    #[error("{} exists already; use mode `append` to continue it or `overwrite` to replace it", .path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another process, or another writer of this one, records into the file.
    #[error("{} is being written by {holder}; wait for it to end, or record to another file", .path.display())]
    Busy {
        /// The file.
        path: PathBuf,
        /// `process 123 on host`, or `another process` where the lock does not say.
        holder: String,
    },
    /// The data to append does not fit the file.
    #[error("cannot append to {}: {reason}; record to another file or use mode `overwrite`", .path.display())]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// What differs.
        reason: String,
    },
    /// The columns cannot be stored, or the calls come in a wrong order.
    #[error("cannot record to {}: {reason}", .path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what is allowed.
        #[source]
        reason: BoxError,
    },
    /// An episode could not be written; the earlier ones are safe.
    #[error("writing to {} failed, its {episodes} finished episodes are safe: {reason}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Episodes that are in the file.
        episodes: u64,
        /// What failed, and where.
        #[source]
        reason: BoxError,
    },
    /// A request for a column, an episode, rows or clips that do not exist.
    #[error("{}: {reason}", .path.display())]
    Request {
        /// The dataset.
        path: PathBuf,
        /// What was asked for, and what exists.
        #[source]
        reason: BoxError,
    },
    /// An episode cannot be replayed to render its images, or the replay is not what was recorded.
    #[error("{}: replay of episode {episode}, row {row}: {reason}", .path.display())]
    Replay {
        /// The dataset.
        path: PathBuf,
        /// Its episode.
        episode: usize,
        /// The row of the episode.
        row: usize,
        /// What failed or differs.
        reason: String,
    },
    /// An option of writing does not fit the format.
    #[error("`{option}`: {reason}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// The settings of a loader are unusable.
    #[error("`{setting}`: {reason}")]
    Loader {
        /// Its name.
        setting: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
}

impl DataError {
    /// An operation on a file or folder failed.
    pub fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, source }
    }

    /// It is none, for a reason.
    pub fn not_a_dataset(path: &Path, reason: impl Into<String>) -> Self {
        Self::NotADataset { path: path.to_owned(), reason: reason.into() }
    }

    /// It is damaged, in this way; or not read, where [`NotBuiltIn`] is among the sources of the reason.
    pub fn damaged(path: &Path, reason: impl Into<BoxError>) -> Self {
        Self::damaged_part(path, None, None, reason.into())
    }

    /// As [`DataError::damaged`], in a part of it.
    pub(super) fn damaged_part(
        path: &Path,
        column: Option<String>,
        episode: Option<usize>,
        reason: BoxError,
    ) -> Self {
        let path = path.to_owned();
        let first: &(dyn Error + 'static) = reason.as_ref();
        match iter::successors(Some(first), |&error| error.source()).any(<dyn Error>::is::<NotBuiltIn>) {
            true => Self::Unsupported { path, column, episode, reason },
            false => Self::Damaged { path, column, episode, reason },
        }
    }

    /// Episodes do not continue it, for a reason.
    pub fn mismatch(path: &Path, reason: impl Into<String>) -> Self {
        Self::Mismatch { path: path.to_owned(), reason: reason.into() }
    }

    /// It cannot be recorded, for a reason.
    pub fn record(path: &Path, reason: impl Into<BoxError>) -> Self {
        Self::Record { path: path.to_owned(), reason: reason.into() }
    }

    /// Its open episode could not be written; it holds so many others.
    pub fn write(path: &Path, episodes: u64, reason: impl Into<BoxError>) -> Self {
        Self::Write { path: path.to_owned(), episodes, reason: reason.into() }
    }

    /// It has not what was asked for.
    pub fn request(path: &Path, reason: impl Into<BoxError>) -> Self {
        Self::Request { path: path.to_owned(), reason: reason.into() }
    }
}

/// The source of an error that is no damage: something valid that this program does not read.
#[derive(Debug, ThisError)]
#[error("{0}")]
pub struct NotBuiltIn(pub Cow<'static, str>);

/// The damaged part, in front of the reason; empty for the whole dataset.
fn part(column: Option<&str>, episode: Option<usize>) -> String {
    let column = column.map(|column| format!("column `{column}`"));
    let parts: Vec<String> = column.into_iter().chain(episode.map(|at| format!("episode {at}"))).collect();
    if parts.is_empty() { String::new() } else { parts.join(", ") + ": " }
}

fn no_format(name: &str) -> String {
    match name.is_empty() {
        true => "the name of a dataset ends with the extension of its format".to_owned(),
        false => format!("unknown dataset format `{name}`"),
    }
}
