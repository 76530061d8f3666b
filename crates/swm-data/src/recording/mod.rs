//! Recording, as far as it is alike in every format: one writer at a time, what to do about a dataset that exists, which
//! call may follow which, and episodes that come in pieces. A format adds how rows are stored ([`Backend`]) and a
//! [`Session`] that writes them; [`BackendWriter`] makes a [`DatasetWriter`] of them.
//!
//! What no format may do otherwise: nothing changes before `begin`; an episode whose end was committed survives a kill at
//! any later moment, and a loss of power once it was synced; of one that was not committed nothing is seen; nothing is
//! recorded into a dataset that is no longer at its path; and nothing is left of a new one that failed before its first episode.

mod backend;
mod end;
mod fit;
mod writer;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, Field, Metadata, Schema};
use swm_files::{WriterLock, replace_unsynced};

use crate::dataset::{Dataset, DatasetWriter, EncodedBatch, RowEncoder, WriteMode, WriteOptions};
use crate::error::{At as _, DataError, Result, invalid};
use crate::format;

pub use self::backend::{Backend, Existing, Session, SessionStart, StepIndex, remove_file};
pub use self::end::end_all;
pub use self::fit::{check_fit, foreign, resolve, with_run};
pub(crate) use self::fit::{check_own, difference};
pub use self::writer::BackendWriter;

/// The episode that a row belongs to, i32: a column that formats fill or make up themselves.
pub const EP_IDX: &str = "ep_idx";

/// As [`replace_unsynced`], with a value as indented JSON.
///
/// # Errors
///
/// It cannot be written.
pub fn replace_json(path: &Path, value: &impl Serialize) -> Result<(), DataError> {
    let bytes = serde_json::to_vec_pretty(value).map_err(|error| DataError::record(path, error))?;
    replace_unsynced(path, &bytes).map_err(|source| DataError::io(path, "write", source))
}

/// A recording into a [`Backend`]'s dataset. Its [`BackendWriter`] shares it with [`end_all`].
struct Recording<S: Backend> {
    path: PathBuf,
    backend: S,
    options: WriteOptions,
    state: State<S::Session>,
    /// Columns of the dataset that is continued.
    continued: Arc<Schema>,
    episodes: u64,
    /// Rows of the open episode; 0: none is open.
    open: usize,
    /// What there was at the path before, if this recording made the dataset.
    made: Option<Before>,
    /// Whether [`EpisodeSink::finish`] ended it: then it may hold no episode.
    is_finished: bool,
    /// Tells the file or folder that is recorded into from any other at its path.
    identity: Option<(u64, u64)>,
    /// When committed episodes were synced last, and how long that took.
    synced: (Instant, Duration),
    /// Until it ends. Declared last: the files must be closed before another writer may have them.
    lock: Option<WriterLock>,
}

/// Committed episodes are synced no more often than this…
const SYNC_PERIOD: Duration = Duration::from_secs(1);
/// …and so seldom that it takes less than such a part of the time.
const SYNC_SHARE: u32 = 10;

/// Tells what is at a path from anything else.
fn identity(path: &Path) -> Option<(u64, u64)> {
    swm_files::identity(&std::fs::metadata(path).ok()?)
}

/// What a recording that makes a dataset finds at its path.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Before {
    Nothing,
    /// An empty folder, or a dataset that is replaced.
    Something,
}

enum State<R> {
    /// Before `begin`.
    Waiting,
    Recording(Box<R>, Arc<Schema>),
    /// Ended, cleanly or by an error.
    Closed,
}

impl<S: Backend> Recording<S> {
    /// As of [`BackendWriter::new`].
    fn new(path: &Path, options: &WriteOptions, backend: S) -> Result<Self, DataError> {
        let path = resolve(path)?;
        let lock = WriterLock::take(&path)?;
        let exists = path.exists();
        if exists && options.mode == WriteMode::Error {
            return Err(DataError::Exists { path });
        }
        if exists && !path.is_file() && !path.is_dir() {
            return Err(DataError::record(&path, "it is neither a regular file nor a folder"));
        }
        // A file that is to be replaced loses a name only.
        if exists && (options.mode == WriteMode::Append || path.is_dir()) {
            check_own(&path)?;
        }
        if exists && path.is_dir() != backend.is_folder() {
            let reason = match backend.is_folder() {
                true => format!("it is a file, the format `{}` is a folder", backend.name()),
                false => "it is a folder".to_owned(),
            };
            return Err(DataError::record(&path, reason));
        }
        let is_new = backend.is_new(&path)?;
        let is_empty = || path.metadata().is_ok_and(|there| there.is_file() && there.len() == 0);
        let is_replaced = options.mode != WriteMode::Append;
        // An empty file, as `mktemp` makes, holds nothing that could be lost.
        if !(is_new || backend.is_dataset(&path) || is_replaced && is_empty()) {
            let other = format::detect(format::built_in(), &path);
            let fix = match other {
                Some(other) if !is_replaced => format!("continue it in the format `{}`", other.name),
                _ => "move it away".to_owned(),
            };
            let reason = format!(
                "it is a {}{}, but no dataset in the format `{}` to {}; {fix}, or choose another name",
                if backend.is_folder() { "folder" } else { "file" },
                other.map(|other| format!(" in the format `{}`", other.name)).unwrap_or_default(),
                backend.name(),
                if is_replaced { "replace" } else { "continue" }
            );
            return Err(DataError::record(&path, reason));
        }
        let mut continued = Arc::default();
        let episodes = match options.mode {
            _ if is_new => 0,
            WriteMode::Append => {
                let there = backend.open(&path)?;
                continued = Arc::clone(there.schema());
                there.num_episodes() as u64
            }
            // A folder that is to be replaced must be read: more would be lost with it than one file.
            _ if backend.is_folder() => {
                backend.open(&path).map_err(|error| {
                    DataError::record(&path, format!("it is a folder, but no dataset to replace: {error}"))
                })?;
                0
            }
            _ => 0,
        };
        Ok(Self {
            path,
            backend,
            options: options.clone(),
            state: State::Waiting,
            continued,
            episodes,
            open: 0,
            made: None,
            is_finished: false,
            identity: None,
            synced: (Instant::now(), Duration::ZERO),
            lock: Some(lock),
        })
    }

    fn start(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<S::Session, DataError> {
        let path = &self.path;
        let fields: Vec<Field> =
            schema.fields().iter().filter(|field| field.name != EP_IDX).cloned().collect();
        let refuse = |reason| Err(DataError::record(path, reason));
        if fields.is_empty() {
            return refuse("there are no columns".to_owned());
        }
        for Field { name, shape, .. } in &fields {
            if let Some(reason) = self.backend.refuses(name) {
                return refuse(format!("`{name}` cannot name a column: {reason}"));
            }
            if shape.contains(&0) {
                return refuse(format!("column `{name}` has the shape {shape:?}, which holds no values"));
            }
        }
        let existing = match self.options.mode {
            _ if self.backend.is_new(path)? => Existing::None,
            WriteMode::Append => Existing::Continued,
            _ => Existing::Replaced,
        };
        let is_empty = || std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
        let made = match existing {
            Existing::None if !path.exists() => Some(Before::Nothing),
            Existing::None if is_empty() => Some(Before::Something),
            // Until the dataset is replaced, it is not this recording's.
            Existing::None | Existing::Continued | Existing::Replaced => None,
        };
        self.made = made;
        let (options, fields, episodes) = (&self.options, &fields[..], self.episodes);
        let session = self.backend.start(&SessionStart {
            path,
            options,
            existing,
            schema,
            fields,
            metadata,
            episodes,
        })?;
        if existing == Existing::Replaced {
            self.made = Some(Before::Something);
        }
        Ok(session)
    }

    /// Whether it failed before the first episode of a dataset that it made itself.
    fn is_failed(&self) -> bool {
        let is_there = self.identity.is_none() || identity(&self.path) == self.identity;
        self.made.is_some() && !self.is_finished && self.episodes == 0 && is_there
    }

    /// Removes what it made. What cannot be removed stays: the error that counts is the first one.
    fn remove(&mut self) {
        // Nothing is synced first: an interrupted command has little time.
        if let State::Recording(recording, _) = std::mem::replace(&mut self.state, State::Closed) {
            recording.abandon();
        }
        let removed = self.backend.remove(&self.path);
        if removed.is_ok() && self.made == Some(Before::Nothing) && self.backend.is_folder() {
            let _ = std::fs::remove_dir(&self.path);
        }
    }

    /// Ends it as far as it has come, for the next writer: what failed before its first episode is removed.
    fn end(&mut self) {
        if self.lock.is_none() {
            return;
        }
        match self.is_failed() {
            true => self.remove(),
            // A caller who wants to know calls `finish`.
            false => drop(self.close()),
        }
        self.lock = None;
    }

    /// Does something with the recording. After an error nothing more is written.
    fn record(
        &mut self,
        work: impl FnOnce(&mut S::Session, StepIndex) -> Result<()>,
    ) -> Result<(), DataError> {
        let State::Recording(recording, _) = &mut self.state else {
            return Err(DataError::record(&self.path, "no recording is going on"));
        };
        let written = i32::try_from(self.episodes)
            .map_err(|_| invalid("too many episodes for the format"))
            .and_then(|episode| work(recording, StepIndex { episode, step: self.open }));
        written.map_err(|error| {
            if let State::Recording(recording, _) = std::mem::replace(&mut self.state, State::Closed) {
                recording.abandon();
            }
            self.failed(error)
        })
    }

    /// Appends rows to the open episode, or opens one.
    fn append(
        &mut self,
        more: usize,
        write: impl FnOnce(&mut S::Session, StepIndex) -> Result<()>,
    ) -> Result<(), BoxError> {
        if more == 0 {
            return Ok(());
        }
        self.record(|recording, at| match i32::try_from(at.step.saturating_add(more)) {
            Ok(_) => write(recording, at).at(format_args!("episode {}", at.episode)),
            Err(_) => Err(invalid("too many rows in an episode for the format")),
        })?;
        self.open += more;
        Ok(())
    }

    /// The open files, while it records.
    fn session(&self) -> Option<&S::Session> {
        match &self.state {
            State::Recording(session, _) => Some(session),
            State::Waiting | State::Closed => None,
        }
    }

    fn check_closed_episode(&self) -> Result<(), DataError> {
        if self.open == 0 { Ok(()) } else { Err(DataError::record(&self.path, "another episode is open")) }
    }

    /// Whether what is recorded into is still at its path; if not, nothing more is written.
    fn check_place(&mut self) -> Result<(), DataError> {
        if self.identity.is_none() || identity(&self.path) == self.identity {
            return Ok(());
        }
        if let State::Recording(recording, _) = std::mem::replace(&mut self.state, State::Closed) {
            recording.abandon();
        }
        let reason =
            "it was removed, moved or replaced while it was being recorded, and its episodes with it";
        Err(DataError::record(&self.path, reason))
    }

    /// Syncs what was committed, if that is due.
    fn sync_if_due(&mut self) -> Result<(), DataError> {
        let (last, took) = self.synced;
        if last.elapsed() < SYNC_PERIOD.max(took * SYNC_SHARE) {
            return Ok(());
        }
        let start = Instant::now();
        self.record(|recording, _| recording.sync())?;
        self.synced = (Instant::now(), start.elapsed());
        Ok(())
    }

    fn close(&mut self) -> Result<(), DataError> {
        if matches!(self.state, State::Recording(..)) {
            self.check_place()?;
            self.record(|recording, _| recording.sync())?;
        }
        match std::mem::replace(&mut self.state, State::Closed) {
            State::Recording(recording, _) if self.open > 0 => {
                recording.cancel();
                Err(self.failed("the last episode was not ended"))
            }
            State::Recording(recording, _) => recording.close().map_err(|error| self.failed(error)),
            State::Waiting | State::Closed => Ok(()),
        }
    }

    fn failed(&self, reason: impl Into<BoxError>) -> DataError {
        DataError::write(&self.path, self.episodes, reason)
    }
}

impl<S: Backend> EpisodeSink for Recording<S> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        if !matches!(self.state, State::Waiting) {
            return Err(DataError::record(&self.path, "the recording has begun already").into());
        }
        let session = self.start(schema, metadata)?;
        // Its name in the folder around it; what it holds is synced with its episodes.
        swm_files::sync(std::slice::from_ref(&self.path))
            .map_err(|error| DataError::io(&self.path, "sync", error))?;
        self.state = State::Recording(Box::new(session), schema.clone());
        self.identity = identity(&self.path);
        Ok(self.episodes)
    }

    fn holds(&self, column: &str) -> bool {
        self.continued.index(column).is_some()
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.check_closed_episode()?;
        self.write_rows(rows)?;
        self.end_episode()
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.session()?.row_encoder(column)
    }

    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        self.check_closed_episode()?;
        self.write_encoded_rows(rows)?;
        self.end_episode()
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        let is_recording = matches!(self.state, State::Recording(..));
        self.close()?;
        self.is_finished = is_recording;
        Ok(())
    }
}

impl<S: Backend> DatasetWriter for Recording<S> {
    fn num_episodes(&self) -> u64 {
        self.episodes
    }

    fn write_rows(&mut self, rows: &Batch) -> Result<(), BoxError> {
        if let State::Recording(_, schema) = &self.state
            && rows.schema() != schema
        {
            let reason = "the episode has other columns than the recording";
            return Err(DataError::record(&self.path, reason).into());
        }
        self.append(rows.rows(), |recording, at| recording.append(at, rows))
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        self.session()?.encoding(column)
    }

    fn assumed_rate(&self) -> Option<f64> {
        self.session()?.assumed_rate()
    }

    fn write_encoded_rows(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        if rows.encoded.is_empty() {
            return self.write_rows(&rows.plain);
        }
        if rows.encoded.iter().any(|(_, encoded)| encoded.len() != rows.rows()) {
            return Err(DataError::record(&self.path, "its columns differ in their numbers of rows").into());
        }
        self.append(rows.rows(), |recording, at| recording.append_encoded(at, rows))
    }

    fn end_episode(&mut self) -> Result<(), BoxError> {
        if self.open == 0 && matches!(self.state, State::Recording(..)) {
            return Err(DataError::record(&self.path, "an episode without rows").into());
        }
        self.check_place()?;
        self.record(Session::commit)?;
        self.open = 0;
        self.episodes += 1;
        Ok(self.sync_if_due()?)
    }
}
