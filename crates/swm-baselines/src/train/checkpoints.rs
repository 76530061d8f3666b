//! Checkpoints in a run's folder: each is whole or not there.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::evaluate::sha256_of;
use swm_files::DRAFT;

use super::folder::{RunFolder, json};
use crate::error::BaselineError;

const CHECKPOINTS: &str = "checkpoints";

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

impl RunFolder {
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

    /// The description of the checkpoint at `step`.
    pub fn description(&self, step: u64) -> PathBuf {
        self.checkpoint_file(step, "json")
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

    pub(super) fn checkpoints_dir(&self) -> PathBuf {
        self.path().join(CHECKPOINTS)
    }

    fn checkpoint_file(&self, step: u64, extension: &str) -> PathBuf {
        self.checkpoints_dir().join(format!("step-{step:08}.{extension}"))
    }

    fn checked(&self, path: PathBuf, hash: &str) -> Result<PathBuf, BaselineError> {
        let found = fs::File::open(&path).and_then(sha256_of);
        match found.map_err(|error| self.damaged(&path, &error.to_string()))? == hash {
            true => Ok(path),
            false => Err(self.damaged(&path, "not what was written, its hash is another")),
        }
    }
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
        let run = RunFolder::create(folder.path(), &"what").unwrap().0;
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
    }

    #[test]
    fn tidying_keeps_the_last_and_the_best() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::create(folder.path(), &"what").unwrap().0;
        for step in 1..=5 {
            write(&run, step, &());
        }
        fs::write(run.path().join("checkpoints/new-step-00000006.safetensors"), b"half").unwrap();
        fs::write(run.weights(7), b"a kill came before the description").unwrap();
        assert_eq!(steps_after(&run, 2, Some(2)), [2, 4, 5]);
        let states = (1..=7).filter(|&step| run.training(step).exists());
        assert_eq!(states.collect::<Vec<_>>(), [5]);
        assert!(run.weights(2).exists() && !run.weights(3).exists() && !run.weights(7).exists());
        assert_eq!(steps_after(&run, 0, None), [5]);
        assert_eq!(fs::read_dir(run.checkpoints_dir()).unwrap().count(), 3);
    }
}
