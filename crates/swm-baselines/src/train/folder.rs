//! The folder of a training run, and how it survives a kill: every file appears whole or not at all, and a checkpoint
//! exists once its description does. Knows files, hashes and JSON; not what weights are.
//!
//! ```text
//! RUN/config.json                              what is trained, on what, how; with statistics of the data
//! RUN/checkpoints/step-00001000.safetensors    weights
//! RUN/checkpoints/step-00001000.training.safetensors   what optimizers remember; of the last checkpoint only
//! RUN/checkpoints/step-00001000.json           where training stood, and the hashes of both; written last
//! RUN/metrics.jsonl                            a line per record
//! RUN/events.out.tfevents.*                    the same for TensorBoard
//! RUN/lock                                     held by the process that trains
//! ```

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use swm_core::evaluate::sha256_of;
use swm_files::WriterLock;

use crate::error::BaselineError;

/// A run's folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

/// Held while a process trains in the folder; the system lets go of it when the process ends, however it ends.
#[derive(Debug)]
pub struct RunLock {
    _lock: WriterLock,
}

const CONFIG: &str = "config.json";

impl RunFolder {
    /// A new run, and the lock that keeps other processes from it: of two that begin at once, one has it before the first file is written.
    ///
    /// # Errors
    ///
    /// A run is there already, another process trains in the folder, or it cannot be written to.
    pub fn create(path: &Path, config: &impl Serialize) -> Result<(Self, RunLock), BaselineError> {
        let run = Self { path: path.to_owned() };
        fs::create_dir_all(path).map_err(|error| run.io("make", path, error))?;
        let lock = run.lock()?;
        if run.config_file().exists() {
            let reason = "a run is there already; resume it, or give another folder";
            return Err(run.wrong(reason));
        }
        fs::create_dir_all(run.checkpoints_dir()).map_err(|error| run.io("make", path, error))?;
        run.write_config(config)?;
        Ok((run, lock))
    }

    /// The run in a folder.
    ///
    /// # Errors
    ///
    /// There is no run.
    pub fn open(path: &Path) -> Result<Self, BaselineError> {
        let run = Self { path: path.to_owned() };
        let config = run.config_file();
        match fs::metadata(&config) {
            Ok(found) if found.is_file() => Ok(run),
            Err(source) if source.kind() == io::ErrorKind::PermissionDenied => {
                Err(run.io("read", &config, source))
            }
            _ if path.exists() => {
                Err(run.wrong("it holds no config.json; `swm train` makes a run"))
            }
            _ => Err(run.wrong(
                "there is no such folder; `swm train` makes a run, and a relative path counts from the current folder",
            )),
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A file of the run, by its name.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The file that says what is trained, on what, and how.
    pub fn config_file(&self) -> PathBuf {
        self.path.join(CONFIG)
    }

    /// What is trained, on what, and how.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is no such description.
    pub fn config<C: DeserializeOwned>(&self) -> Result<C, BaselineError> {
        self.read_json(&self.config_file())
    }

    /// Changes it.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write_config(&self, config: &impl Serialize) -> Result<(), BaselineError> {
        self.replace(&self.config_file(), &json(config))
    }

    /// Keeps other processes from training in the folder.
    ///
    /// # Errors
    ///
    /// Another process trains in it, or the folder cannot be written to.
    pub fn lock(&self) -> Result<RunLock, BaselineError> {
        Ok(RunLock { _lock: WriterLock::take_within(&self.path)? })
    }

    /// Puts `bytes` in the place of the file at `path`: at any moment the old content stands there or the new, also
    /// after a loss of power.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn replace(&self, path: &Path, bytes: &[u8]) -> Result<(), BaselineError> {
        swm_files::replace(path, bytes).map_err(|error| self.io("write", path, error))
    }

    /// Lets `save` write a file, and puts it in its place when it is whole; its hash.
    pub(super) fn place(
        &self,
        path: &Path,
        save: impl FnOnce(&Path) -> Result<(), BaselineError>,
    ) -> Result<String, BaselineError> {
        let draft = swm_files::draft(path);
        save(&draft)?;
        let settle = || {
            let hash = sha256_of(File::open(&draft)?)?;
            File::open(&draft)?.sync_all()?;
            swm_files::settle(&draft, path)?;
            Ok(hash)
        };
        settle().map_err(|error| self.io("write", path, error))
    }

    /// Refuses to end the run after `steps` steps where it has learned for more: its `config.json`, which receipts hash, would
    /// say what is not so.
    pub(crate) fn check_longer(&self, steps: u64) -> Result<(), BaselineError> {
        match self.steps()?.last() {
            Some(&done) if steps < done => Err(self.wrong(format!(
                "it has learned for {done} steps, and {steps} were asked for; ask for more than {done} to continue it, or make a \
                 new run"
            ))),
            _ => Ok(()),
        }
    }

    /// An error about this run.
    pub(crate) fn wrong(&self, reason: impl Into<String>) -> BaselineError {
        BaselineError::Run { path: self.path.clone(), reason: reason.into() }
    }

    pub(crate) fn io(&self, action: &'static str, path: &Path, source: io::Error) -> BaselineError {
        BaselineError::Io { action, path: path.to_owned(), source }
    }

    pub(super) fn read_json<T: DeserializeOwned>(&self, path: &Path) -> Result<T, BaselineError> {
        let bytes = fs::read(path).map_err(|error| self.io("read", path, error))?;
        serde_json::from_slice(&bytes).map_err(|error| self.damaged(path, &error.to_string()))
    }

    /// About a file that others have damaged: by itself a run has whole ones only.
    pub(crate) fn damaged(&self, path: &Path, reason: &str) -> BaselineError {
        let fix =
            "bring back a copy of it, plan with an earlier checkpoint (`checkpoint=STEP`), or make a new run";
        self.wrong(format!("{}: {reason}; {fix}", path.display()))
    }
}

pub(super) fn json(value: &impl Serialize) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("plain data with text keys");
    text.push(b'\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_made_once_and_says_what_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let (run, lock) = RunFolder::create(folder.path(), &"what").unwrap();
        drop(lock);
        assert!(RunFolder::create(folder.path(), &"what").unwrap_err().to_string().contains("resume it"));
        assert_eq!(RunFolder::open(folder.path()).unwrap().config::<String>().unwrap(), "what");
        fs::write(run.config_file(), b"\"wha").unwrap();
        let message = run.config::<String>().unwrap_err().to_string();
        assert!(message.contains("config.json: EOF") && message.contains("bring back a copy"), "{message}");
    }

    #[test]
    fn one_process_trains_in_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (run, lock) = RunFolder::create(folder.path(), &"what").unwrap();
        let process = format!("process {}", std::process::id());
        assert!(run.lock().unwrap_err().to_string().contains(&process));
        let loser = RunFolder::create(folder.path(), &"another").unwrap_err().to_string();
        assert!(loser.contains(&process), "{loser}");
        assert_eq!(run.config::<String>().unwrap(), "what");
        drop(lock);
        run.lock().unwrap();
    }
}
