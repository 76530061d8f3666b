//! The ledger of a running evaluation: a line per finished episode, so that an interrupted one goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, sha256};

use crate::text_file::read_text;

/// A file of finished episodes.
pub struct Ledger {
    path: PathBuf,
    file: File,
    /// What is known already.
    pub known: BTreeMap<u64, EpisodeResult>,
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
        let evaluation = sha256(serde_json::to_string(identity)?.as_bytes());
        let head = Head { evaluation };
        let mut known = BTreeMap::new();
        if path.exists() {
            let text = read_text(path).map_err(failed)?;
            let mut lines = text.lines();
            let found = lines.next().and_then(|line| serde_json::from_str::<Head>(line).ok());
            if found.is_some_and(|found| found != head) {
                return Err(format!(
                    "{} holds episodes of another evaluation (manifest, policy, seed or physics differ); remove it, or give \
                     another folder",
                    path.display()
                )
                .into());
            }
            let complete = lines.map_while(|line| serde_json::from_str::<Line>(line).ok());
            known.extend(complete.map(|line| (line.episode, line.result)));
        }
        // Written anew, so that what follows a line that was cut off is not lost.
        let mut text = serde_json::to_string(&head)? + "\n";
        for (&episode, result) in &known {
            text += &(serde_json::to_string(&Line { episode, result: result.clone() })? + "\n");
        }
        let new = path.with_extension("new");
        fs::write(&new, text).and_then(|()| fs::rename(&new, path)).map_err(failed)?;
        let file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        Ok(Self { path: path.to_owned(), file, known })
    }

    /// Appends a finished episode.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn push(&mut self, episode: u64, result: &EpisodeResult) -> Result<(), BoxError> {
        let line = serde_json::to_string(&Line { episode, result: result.clone() })? + "\n";
        let written = self.file.write_all(line.as_bytes());
        Ok(written.map_err(|error| format!("cannot write {}: {error}", self.path.display()))?)
    }

    /// Removes the file: the receipt holds everything.
    ///
    /// # Errors
    ///
    /// The file cannot be removed.
    pub fn close(self) -> Result<(), BoxError> {
        let Self { path, file, known: _ } = self;
        drop(file);
        Ok(fs::remove_file(&path).map_err(|error| format!("cannot remove {}: {error}", path.display()))?)
    }
}
