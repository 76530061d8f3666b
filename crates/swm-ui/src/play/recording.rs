//! Recording what was steered: each kept episode is run again, by its seed, factors and actions, into the dataset. So a file
//! holds what `swm collect` would have written, in its own image size, and the last episode can be taken back.

use std::path::PathBuf;

use serde::Serialize;
use swm_core::dataset::DatasetRecorder;
use swm_core::{ImageSize, Registry};
use swm_data::WriteMode;
use swm_tasks::request::{Record, TaskError};

use super::take::{Ending, Take};

/// A file that grows by kept episodes. The last one waits until another is kept, so that it can be undone.
pub(super) struct Recording {
    pub name: String,
    path: PathBuf,
    format: Option<String>,
    image: ImageSize,
    registry: Registry,
    /// Episodes that the file holds.
    in_file: u64,
    waiting: Option<Take>,
}

/// What the page shows of a recording.
#[derive(Debug, Serialize)]
pub(super) struct Status {
    pub file: String,
    /// As paths of datasets are given in requests.
    pub id: String,
    pub in_file: u64,
    /// The kept episode that can be undone.
    pub waiting: Option<Ending>,
}

impl Recording {
    /// Begins or continues a file. Nothing is written before an episode is kept.
    ///
    /// # Errors
    ///
    /// The name says no format, another program writes to the file, it is no dataset.
    pub(super) fn begin(
        registry: &Registry,
        path: PathBuf,
        name: String,
        format: Option<String>,
        image: ImageSize,
    ) -> Result<Self, TaskError> {
        let registry = registry.clone();
        let in_file = swm_data::create_in(&registry, &path, &WriteMode::Append.into(), format.as_deref())?
            .num_episodes();
        Ok(Self { name, path, format, image, registry, in_file, waiting: None })
    }

    /// Keeps an episode; the one before goes into the file.
    pub(super) fn keep(&mut self, take: Take) -> Result<(), TaskError> {
        self.commit()?;
        self.waiting = Some(take);
        Ok(())
    }

    /// Drops the episode that was kept last.
    pub(super) fn undo(&mut self) -> Result<(), TaskError> {
        let undone =
            self.waiting.take().ok_or("there is no episode to undo: earlier ones are in the file")?;
        drop(undone);
        Ok(())
    }

    pub(super) fn status(&self, id: String) -> Status {
        let waiting = self.waiting.as_ref().map(|take| take.end.clone());
        Status { file: self.name.clone(), id, in_file: self.in_file, waiting }
    }

    /// Writes the episode that waits.
    ///
    /// # Errors
    ///
    /// It does not fit the file, or cannot be written; it then waits on.
    pub(super) fn commit(&mut self) -> Result<(), TaskError> {
        let Some(take) = &self.waiting else { return Ok(()) };
        self.in_file = self.write(take)?;
        self.waiting = None;
        Ok(())
    }

    /// Runs an episode again, into the file. Returns how many episodes that holds.
    fn write(&self, take: &Take) -> Result<u64, TaskError> {
        let request = Record {
            env: take.entry.id.to_owned(),
            episodes: Some(1),
            seed: take.run_seed,
            image_size: Some(self.image),
            out: self.path.clone(),
            format: self.format.clone(),
            mode: WriteMode::Append,
            // Episodes that were played go into any file that takes them.
            mix: true,
            ..Record::default()
        };
        let recorded = request.write(&self.registry, &mut (), |episodes, _cancel, sink, _count| {
            Ok(take.repeat(episodes.start, self.image, None, &mut DatasetRecorder::new(sink))?)
        })?;
        Ok(recorded.total_episodes)
    }
}
