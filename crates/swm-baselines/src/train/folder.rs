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

use std::fs::{self, File, TryLockError};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::evaluate::sha256;

use crate::error::BaselineError;

/// A run's folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

/// A checkpoint that is whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Checkpoint<S> {
    /// Optimizer steps before it.
    pub step: u64,
    /// SHA-256 of the weights.
    pub weights: String,
    /// SHA-256 of what the optimizers remember.
    pub training: String,
    /// Where training stood.
    pub state: S,
}

/// Held while a process trains in the folder; the system lets go of it when the process ends, however it ends.
#[derive(Debug)]
pub struct RunLock {
    _file: File,
}

const CONFIG: &str = "config.json";
const CHECKPOINTS: &str = "checkpoints";
/// What the names of files that are being written begin with.
const DRAFT: &str = "new-";

impl RunFolder {
    /// A new run.
    ///
    /// # Errors
    ///
    /// A run is there already, or the folder cannot be written to.
    pub fn create(path: &Path, config: &impl Serialize) -> Result<Self, BaselineError> {
        let run = Self { path: path.to_owned() };
        if run.config_file().exists() {
            let reason = "a run is there already; give --resume to go on with it, or another folder";
            return Err(run.wrong(reason));
        }
        fs::create_dir_all(run.checkpoints_dir()).map_err(|error| run.io("make", path, error))?;
        run.write_config(config)?;
        Ok(run)
    }

    /// The run in a folder.
    ///
    /// # Errors
    ///
    /// There is no run.
    pub fn open(path: &Path) -> Result<Self, BaselineError> {
        let run = Self { path: path.to_owned() };
        match run.config_file().is_file() {
            true => Ok(run),
            false => Err(run.wrong("it holds no config.json; `swm train … --out DIR` makes a run")),
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
        let path = self.path.join("lock");
        let file = File::create(&path).map_err(|error| self.io("open", &path, error))?;
        match file.try_lock() {
            Ok(()) => Ok(RunLock { _file: file }),
            Err(TryLockError::WouldBlock) => {
                Err(self.wrong("another process trains in it; wait for it, or use another folder"))
            }
            Err(TryLockError::Error(error)) => Err(self.io("lock", &path, error)),
        }
    }

    /// The steps of all checkpoints that are whole, ascending.
    ///
    /// # Errors
    ///
    /// The folder of the checkpoints cannot be read.
    pub fn steps(&self) -> Result<Vec<u64>, BaselineError> {
        let folder = self.checkpoints_dir();
        let entries = fs::read_dir(&folder).map_err(|error| self.io("read", &folder, error))?;
        let mut steps = Vec::new();
        for entry in entries {
            let name = entry.map_err(|error| self.io("read", &folder, error))?.file_name();
            let step = name.to_string_lossy();
            let step = step.strip_prefix("step-").and_then(|rest| rest.strip_suffix(".json"));
            steps.extend(step.and_then(|step| step.parse::<u64>().ok()));
        }
        steps.sort_unstable();
        Ok(steps)
    }

    /// The description of the checkpoint at `step`.
    ///
    /// # Errors
    ///
    /// There is no such checkpoint, or it cannot be read.
    pub fn checkpoint<S: DeserializeOwned>(&self, step: u64) -> Result<Checkpoint<S>, BaselineError> {
        self.read_json(&self.checkpoint_file(step, "json"))
    }

    /// The weights at `step`.
    pub fn weights(&self, step: u64) -> PathBuf {
        self.checkpoint_file(step, "safetensors")
    }

    /// What the optimizers remember at `step`.
    pub fn training(&self, step: u64) -> PathBuf {
        self.checkpoint_file(step, "training.safetensors")
    }

    /// The weights of a checkpoint, once their hash has been compared.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or has another hash.
    pub fn checked_weights<S>(&self, checkpoint: &Checkpoint<S>) -> Result<PathBuf, BaselineError> {
        self.checked(self.weights(checkpoint.step), &checkpoint.weights)
    }

    /// What the optimizers remember, once its hash has been compared.
    ///
    /// # Errors
    ///
    /// As of [`RunFolder::checked_weights`].
    pub fn checked_training<S>(&self, checkpoint: &Checkpoint<S>) -> Result<PathBuf, BaselineError> {
        self.checked(self.training(checkpoint.step), &checkpoint.training)
    }

    /// Adds a checkpoint; the two functions write a file of safetensors each. When this returns, a kill can no longer
    /// lose it.
    ///
    /// # Errors
    ///
    /// One of the functions fails, or a file cannot be written. Earlier checkpoints stay.
    pub fn write_checkpoint(
        &self,
        step: u64,
        save_weights: impl FnOnce(&Path) -> Result<(), BaselineError>,
        save_training: impl FnOnce(&Path) -> Result<(), BaselineError>,
        state: &impl Serialize,
    ) -> Result<(), BaselineError> {
        let weights = self.place(&self.weights(step), save_weights)?;
        let training = self.place(&self.training(step), save_training)?;
        let description = Checkpoint { step, weights, training, state };
        self.replace(&self.checkpoint_file(step, "json"), &json(&description))
    }

    /// Removes what is not needed: checkpoints but the last `keep` and that of step `best`, what optimizers remember but
    /// the last, and what a kill left: files half written, and those of a checkpoint without a description.
    ///
    /// # Errors
    ///
    /// A file cannot be removed.
    pub fn tidy(&self, keep: usize, best: Option<u64>) -> Result<(), BaselineError> {
        let steps = self.steps()?;
        let (old, kept) = steps.split_at(steps.len().saturating_sub(keep.max(1)));
        let gone = |path: PathBuf| match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(self.io("remove", &path, error)),
            _ => Ok(()),
        };
        for &step in old.iter().filter(|&&step| Some(step) != best) {
            // The description first: what is left without it is no checkpoint.
            gone(self.checkpoint_file(step, "json"))?;
            gone(self.weights(step))?;
        }
        for &step in old.iter().chain(kept.split_last().map_or(&[][..], |(_, others)| others)) {
            gone(self.training(step))?;
        }
        let folder = self.checkpoints_dir();
        let entries = fs::read_dir(&folder).map_err(|error| self.io("read", &folder, error))?;
        for entry in entries.filter_map(Result::ok) {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let step =
                name.strip_prefix("step-").and_then(|rest| rest.split('.').next()?.parse::<u64>().ok());
            if name.starts_with(DRAFT) || step.is_some_and(|step| !steps.contains(&step)) {
                gone(entry.path())?;
            }
        }
        Ok(())
    }

    /// Puts `bytes` in the place of the file at `path`: at any moment the old content stands there or the new, also
    /// after a loss of power.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn replace(&self, path: &Path, bytes: &[u8]) -> Result<(), BaselineError> {
        let draft = draft(path);
        let write = || {
            let mut file = File::create(&draft)?;
            file.write_all(bytes)?;
            file.sync_all()?;
            fs::rename(&draft, path)
        };
        write().map_err(|error| self.io("write", path, error))
    }

    /// Lets `save` write a file, and puts it in its place when it is whole; its hash.
    fn place(
        &self,
        path: &Path,
        save: impl FnOnce(&Path) -> Result<(), BaselineError>,
    ) -> Result<String, BaselineError> {
        let draft = draft(path);
        save(&draft)?;
        let settle = || {
            let hash = sha256(&fs::read(&draft)?);
            File::open(&draft)?.sync_all()?;
            fs::rename(&draft, path)?;
            Ok(hash)
        };
        settle().map_err(|error| self.io("write", path, error))
    }

    /// An error about this run.
    pub(crate) fn wrong(&self, reason: impl Into<String>) -> BaselineError {
        BaselineError::Run { path: self.path.clone(), reason: reason.into() }
    }

    pub(crate) fn io(&self, action: &'static str, path: &Path, source: io::Error) -> BaselineError {
        BaselineError::Io { action, path: path.to_owned(), source }
    }

    fn checkpoints_dir(&self) -> PathBuf {
        self.path.join(CHECKPOINTS)
    }

    fn checkpoint_file(&self, step: u64, extension: &str) -> PathBuf {
        self.checkpoints_dir().join(format!("step-{step:08}.{extension}"))
    }

    fn read_json<T: DeserializeOwned>(&self, path: &Path) -> Result<T, BaselineError> {
        let bytes = fs::read(path).map_err(|error| self.io("read", path, error))?;
        serde_json::from_slice(&bytes).map_err(|error| self.damaged(path, &error.to_string()))
    }

    fn checked(&self, path: PathBuf, hash: &str) -> Result<PathBuf, BaselineError> {
        let bytes = fs::read(&path).map_err(|error| self.damaged(&path, &error.to_string()))?;
        match sha256(&bytes) == hash {
            true => Ok(path),
            false => Err(self.damaged(&path, "not what was written, its hash is another")),
        }
    }

    /// About a file that others have damaged: by itself a run has whole ones only.
    fn damaged(&self, path: &Path, reason: &str) -> BaselineError {
        let fix =
            "bring back a copy of it, plan with an earlier checkpoint (`checkpoint=STEP`), or make a new run";
        self.wrong(format!("{}: {reason}; {fix}", path.display()))
    }
}

/// Where a file is written before it takes its place. Its name ends as the file's own: that says what is in it.
fn draft(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{DRAFT}{name}"))
}

fn json(value: &impl Serialize) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("plain data with text keys");
    text.push(b'\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(run: &RunFolder, step: u64, state: &impl Serialize) {
        let save = |bytes: &'static [u8]| {
            move |path: &Path| {
                fs::write(path, bytes).unwrap();
                Ok(())
            }
        };
        run.write_checkpoint(step, save(b"weights"), save(b"moments"), state).unwrap();
    }

    fn steps_after(run: &RunFolder, keep: usize, best: Option<u64>) -> Vec<u64> {
        run.tidy(keep, best).unwrap();
        run.steps().unwrap()
    }

    #[test]
    fn checkpoints_are_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), &"what").unwrap();
        assert!(RunFolder::create(folder.path(), &"what").unwrap_err().to_string().contains("--resume"));
        assert_eq!(RunFolder::open(folder.path()).unwrap().config::<String>().unwrap(), "what");

        write(&run, 7, &[1, 2]);
        // A kill before the description leaves the weights of a checkpoint that does not exist.
        fs::write(run.weights(9), b"half").unwrap();
        assert_eq!(run.steps().unwrap(), [7]);
        let checkpoint: Checkpoint<Vec<u32>> = run.checkpoint(7).unwrap();
        assert_eq!((checkpoint.step, &checkpoint.state), (7, &vec![1, 2]));
        assert_eq!(fs::read(run.checked_weights(&checkpoint).unwrap()).unwrap(), b"weights");
        assert_eq!(fs::read(run.checked_training(&checkpoint).unwrap()).unwrap(), b"moments");

        fs::write(run.weights(7), b"weight").unwrap();
        let message = run.checked_weights(&checkpoint).unwrap_err().to_string();
        assert!(message.contains("step-00000007.safetensors") && message.contains("earlier"), "{message}");
        fs::remove_file(run.training(7)).unwrap();
        let message = run.checked_training(&checkpoint).unwrap_err().to_string();
        assert!(message.contains("training.safetensors: ") && message.contains("a new run"), "{message}");
        fs::write(run.config_file(), b"\"wha").unwrap();
        let message = run.config::<String>().unwrap_err().to_string();
        assert!(message.contains("config.json: EOF") && message.contains("bring back a copy"), "{message}");
    }

    #[test]
    fn tidying_keeps_the_last_and_the_best() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), &"what").unwrap();
        for step in 1..=5 {
            write(&run, step, &());
        }
        fs::write(run.path.join("checkpoints/new-step-00000006.safetensors"), b"half").unwrap();
        fs::write(run.weights(7), b"a kill came before the description").unwrap();
        assert_eq!(steps_after(&run, 2, Some(2)), [2, 4, 5]);
        let states = (1..=7).filter(|&step| run.training(step).exists());
        assert_eq!(states.collect::<Vec<_>>(), [5]);
        assert!(run.weights(2).exists() && !run.weights(3).exists() && !run.weights(7).exists());
        assert_eq!(steps_after(&run, 0, None), [5]);
        assert_eq!(fs::read_dir(run.checkpoints_dir()).unwrap().count(), 3);
    }

    #[test]
    fn one_process_trains_in_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), &"what").unwrap();
        let lock = run.lock().unwrap();
        assert!(run.lock().unwrap_err().to_string().contains("another process"));
        drop(lock);
        run.lock().unwrap();
    }
}
