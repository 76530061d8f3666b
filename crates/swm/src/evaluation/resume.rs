//! The ledger of a running evaluation: a line per finished episode, so that an interrupted one goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, sha256};

use crate::text_file::{read_text, replace_text};

/// A file of finished episodes.
pub struct Ledger {
    path: PathBuf,
    file: Option<File>,
    /// What is known already.
    pub known: BTreeMap<u64, EpisodeResult>,
    /// Seconds that each known episode took after the one before it.
    pub(super) seconds: BTreeMap<u64, f64>,
    is_finished: bool,
    /// When the last episode was written.
    last: Instant,
}

/// The first line: what the episodes belong to.
#[derive(PartialEq, Serialize, Deserialize)]
struct Head {
    evaluation: String,
}

#[derive(Serialize, Deserialize)]
struct Line {
    episode: u64,
    #[serde(flatten)]
    result: EpisodeResult,
    /// Seconds since the line before it, or since the ledger was opened.
    #[serde(default)]
    seconds: f64,
}

/// The last line of a part that is complete.
#[derive(Serialize, Deserialize)]
struct End {
    finished: bool,
}

impl Ledger {
    /// Opens or begins the ledger `path` of the evaluation that `identity` describes. One that belongs to another
    /// evaluation is refused, and a line that was cut off is left out.
    ///
    /// # Errors
    ///
    /// It belongs to another evaluation, or cannot be read or written.
    pub fn open(path: &Path, identity: &impl Serialize) -> Result<Self, BoxError> {
        let failed = |error: std::io::Error| format!("cannot write {}: {error}", path.display());
        let mut ledger = match path.exists() {
            true => Self::read(path, identity)?,
            false => Self::empty(path),
        };
        // Written anew, so that what follows a line that was cut off is not lost.
        let mut text = serde_json::to_string(&Head::of(identity)?)? + "\n";
        for (&episode, result) in &ledger.known {
            let seconds = ledger.seconds.get(&episode).copied().unwrap_or_default();
            text += &(serde_json::to_string(&Line { episode, result: result.clone(), seconds })? + "\n");
        }
        replace_text(path, &text).map_err(failed)?;
        ledger.file = Some(OpenOptions::new().append(true).open(path).map_err(failed)?);
        ledger.is_finished = false;
        Ok(ledger)
    }

    /// Reads a ledger that is there, and leaves it as it is.
    ///
    /// # Errors
    ///
    /// It belongs to another evaluation, or cannot be read.
    pub(super) fn read(path: &Path, identity: &impl Serialize) -> Result<Self, BoxError> {
        let text = read_text(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        let mut lines = text.lines();
        let found = lines.next().and_then(|line| serde_json::from_str::<Head>(line).ok());
        let head = Head::of(identity)?;
        if found.is_some_and(|found| found != head) {
            return Err(format!(
                "{} holds episodes of another evaluation (manifest, policy, seed or physics differ); remove it, or give \
                 another folder",
                path.display()
            )
            .into());
        }
        let mut ledger = Self::empty(path);
        for line in lines {
            let Ok(Line { episode, result, seconds }) = serde_json::from_str(line) else {
                ledger.is_finished = serde_json::from_str::<End>(line).is_ok_and(|end| end.finished);
                break;
            };
            ledger.known.insert(episode, result);
            ledger.seconds.insert(episode, seconds);
        }
        Ok(ledger)
    }

    fn empty(path: &Path) -> Self {
        let (known, seconds) = (BTreeMap::new(), BTreeMap::new());
        Self { path: path.to_owned(), file: None, known, seconds, is_finished: false, last: Instant::now() }
    }

    /// Whether [`Ledger::finish`] ended it.
    pub(super) fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// Appends a finished episode.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn push(&mut self, episode: u64, result: &EpisodeResult) -> Result<(), BoxError> {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        self.write(&Line { episode, result: result.clone(), seconds })
    }

    fn write(&mut self, line: &impl Serialize) -> Result<(), BoxError> {
        let line = serde_json::to_string(line)? + "\n";
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write_all(line.as_bytes()));
        Ok(written.map_err(|error| format!("cannot write {}: {error}", self.path.display()))?)
    }

    /// Ends the file: it holds every episode of its part.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub(super) fn finish(mut self) -> Result<(), BoxError> {
        self.write(&End { finished: true })
    }

    /// Removes the file: the receipt holds everything.
    ///
    /// # Errors
    ///
    /// The file cannot be removed.
    pub fn close(self) -> Result<(), BoxError> {
        let Self { path, file, .. } = self;
        drop(file);
        Ok(fs::remove_file(&path).map_err(|error| format!("cannot remove {}: {error}", path.display()))?)
    }
}

impl Head {
    fn of(identity: &impl Serialize) -> Result<Self, BoxError> {
        Ok(Self { evaluation: sha256(serde_json::to_string(identity)?.as_bytes()) })
    }
}
