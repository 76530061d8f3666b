//! The ledger of a running evaluation: a line per finished episode, so that an interrupted one goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::evaluate::{EpisodeResult, sha256};
use swm_files::WriterLock;

use crate::error::{TaskError, cannot};
use crate::text_file::{read_text, replace_text};

/// A file of finished episodes.
pub struct Ledger {
    path: PathBuf,
    file: Option<File>,
    /// Held while it is written: another process would write the same episodes.
    lock: Option<WriterLock>,
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

/// What the episodes of an evaluation belong to: all that `parts`, a tuple, says, and the files of its policy by their hashes, if
/// it has any. Weights may be trained anew under the same name.
///
/// # Errors
///
/// `parts` cannot be written as JSON.
pub fn identity(parts: &impl Serialize, files: &BTreeMap<String, String>) -> Result<Vec<Json>, TaskError> {
    let mut all = match serde_json::to_value(parts)? {
        Json::Array(all) => all,
        one => vec![one],
    };
    if !files.is_empty() {
        all.push(serde_json::to_value(files)?);
    }
    Ok(all)
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
    /// It belongs to another evaluation, another process writes it, or it cannot be read or written.
    pub fn open(path: &Path, identity: &impl Serialize) -> Result<Self, TaskError> {
        Self::open_locked(path, identity, WriterLock::take(path)?)
    }

    fn open_locked(path: &Path, identity: &impl Serialize, lock: WriterLock) -> Result<Self, TaskError> {
        let failed = cannot("write", path);
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
        ledger.lock = Some(lock);
        Ok(ledger)
    }

    /// As [`Ledger::open`], but one that belongs to another evaluation is replaced.
    ///
    /// # Errors
    ///
    /// It cannot be read or written.
    pub fn open_again(path: &Path, identity: &impl Serialize) -> Result<Self, TaskError> {
        let lock = WriterLock::take(path)?;
        if path.exists() && Self::read(path, identity).is_err() {
            fs::remove_file(path).map_err(cannot("remove", path))?;
        }
        Self::open_locked(path, identity, lock)
    }

    /// Reads a ledger that is there, and leaves it as it is.
    ///
    /// # Errors
    ///
    /// It belongs to another evaluation, or cannot be read.
    pub(super) fn read(path: &Path, identity: &impl Serialize) -> Result<Self, TaskError> {
        let text = read_text(path).map_err(cannot("read", path))?;
        let mut lines = text.lines();
        let found = lines.next().and_then(|line| serde_json::from_str::<Head>(line).ok());
        let head = Head::of(identity)?;
        let is_others = found.is_some_and(|found| found != head);
        let mut lines = lines.peekable();
        // Of an evaluation that failed before its first episode, nothing is lost.
        if is_others && lines.peek().is_none() {
            return Ok(Self::empty(path));
        }
        if is_others {
            return Err(format!(
                "{} holds episodes of another evaluation (manifest, policy, its files, seed or physics differ); remove it, or \
                 give another folder",
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

    /// Whether a ledger is there that belongs to the evaluation.
    pub(super) fn is_of(path: &Path, identity: &impl Serialize) -> bool {
        let Ok(text) = read_text(path) else { return false };
        let head = text.lines().next().and_then(|line| serde_json::from_str::<Head>(line).ok());
        head.zip(Head::of(identity).ok()).is_some_and(|(found, head)| found == head)
    }

    fn empty(path: &Path) -> Self {
        let (known, seconds) = (BTreeMap::new(), BTreeMap::new());
        let (path, last) = (path.to_owned(), Instant::now());
        Self { path, file: None, lock: None, known, seconds, is_finished: false, last }
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
    pub fn push(&mut self, episode: u64, result: &EpisodeResult) -> Result<(), TaskError> {
        let seconds = self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
        self.write(&Line { episode, result: result.clone(), seconds })
    }

    fn write(&mut self, line: &impl Serialize) -> Result<(), TaskError> {
        let line = serde_json::to_string(line)? + "\n";
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write_all(line.as_bytes()));
        Ok(written.map_err(cannot("write", &self.path))?)
    }

    /// Ends the file: it holds every episode of its part.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub(super) fn finish(mut self) -> Result<(), TaskError> {
        self.write(&End { finished: true })
    }

    /// Removes the file: the receipt holds everything.
    ///
    /// # Errors
    ///
    /// The file cannot be removed.
    pub fn close(self) -> Result<(), TaskError> {
        let Self { path, file, lock: _lock, .. } = self;
        drop(file);
        Ok(fs::remove_file(&path).map_err(cannot("remove", &path))?)
    }
}

impl Head {
    fn of(identity: &impl Serialize) -> Result<Self, TaskError> {
        Ok(Self { evaluation: sha256(serde_json::to_string(identity)?.as_bytes()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(hash: &str) -> BTreeMap<String, String> {
        BTreeMap::from([("runs/lewm/weights".to_owned(), hash.to_owned())])
    }

    #[test]
    fn weights_that_were_trained_anew_are_another_evaluation() {
        let of = |files: &BTreeMap<String, String>| identity(&("manifest", "mpc:runs/lewm"), files).unwrap();
        assert_ne!(of(&files("a")), of(&files("b")));
        // As ledgers of policies without files have always said it.
        assert_eq!(of(&BTreeMap::new()), [Json::from("manifest"), "mpc:runs/lewm".into()]);
    }

    #[test]
    fn a_ledger_of_another_evaluation_is_replaced_where_nothing_is_lost_or_on_request() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episodes.jsonl");
        drop(Ledger::open(&path, &"failed before its first episode").unwrap());
        let mut ledger = Ledger::open(&path, &"first").unwrap();
        ledger.push(0, &EpisodeResult::default()).unwrap();
        drop(ledger);
        let message = Ledger::open(&path, &"second").err().expect("it has an episode").to_string();
        assert!(message.contains("episodes.jsonl holds episodes of another evaluation"), "{message}");
        assert_eq!(Ledger::open(&path, &"first").unwrap().known.len(), 1);
        assert_eq!(Ledger::open_again(&path, &"first").unwrap().known.len(), 1);
        assert!(Ledger::open_again(&path, &"second").unwrap().known.is_empty());
        assert!(Ledger::open(&path, &"second").is_ok());
    }
}
