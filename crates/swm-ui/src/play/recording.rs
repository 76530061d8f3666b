//! Recording what was steered: each kept episode is run again, by its seed, factors and actions, into the dataset. So a file
//! holds what `swm collect` would have written, in its own image size, and the last episode can be taken back.

use std::path::PathBuf;

use serde::Serialize;
use swm_core::dataset::DatasetRecorder;
use swm_core::error::BoxError;
use swm_core::{
    Batch, Column, EnvConfig, EnvEntry, EpisodeEnd, EpisodeSeed, EpisodeSink, ImageSize, LiveStep, Metadata,
    Recorder, Registry, ResetOptions, Rollout, Schema, World, WorldOptions, policy,
};
use swm_data::{DatasetWriter, WriteMode, WriteOptions};

/// An episode that was played: everything that repeats it.
#[derive(Clone)]
pub(super) struct Take {
    pub entry: &'static EnvEntry,
    pub config: EnvConfig,
    /// Steps after which it is truncated.
    pub limit: Option<u64>,
    pub frame_skip: u32,
    pub run_seed: u64,
    pub seed: EpisodeSeed,
    pub options: ResetOptions,
    /// Of every step, `[A]` each.
    pub actions: Vec<Column>,
    /// Who acted.
    pub actors: String,
    pub end: Ending,
}

/// How an episode went, for the page and for the comparison with its repetition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Ending {
    pub steps: u64,
    pub success: Option<bool>,
    pub total_reward: f64,
}

impl From<&EpisodeEnd> for Ending {
    fn from(end: &EpisodeEnd) -> Self {
        Self { steps: end.steps, success: end.success, total_reward: end.total_reward }
    }
}

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
    ) -> Result<Self, BoxError> {
        let registry = registry.clone();
        let in_file = swm_data::create_in(&registry, &path, &append(), format.as_deref())?.num_episodes();
        Ok(Self { name, path, format, image, registry, in_file, waiting: None })
    }

    /// Keeps an episode; the one before goes into the file.
    pub(super) fn keep(&mut self, take: Take) -> Result<(), BoxError> {
        self.commit()?;
        self.waiting = Some(take);
        Ok(())
    }

    /// Drops the episode that was kept last.
    pub(super) fn undo(&mut self) -> Result<(), BoxError> {
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
    pub(super) fn commit(&mut self) -> Result<(), BoxError> {
        let Some(take) = &self.waiting else { return Ok(()) };
        self.in_file = self.write(take)?;
        self.waiting = None;
        Ok(())
    }

    /// Runs an episode again, into the file. Returns how many episodes that holds.
    fn write(&self, take: &Take) -> Result<u64, BoxError> {
        let columns = match swm_data::open_in(&self.registry, &self.path) {
            Ok(there) => there.schema().fields().iter().map(|field| field.name.clone()).collect(),
            Err(_) => Vec::new(),
        };
        let mut writer = swm_data::create_in(&self.registry, &self.path, &append(), self.format.as_deref())?;
        let held = writer.num_episodes();
        let config = EnvConfig { image: Some(self.image), ..take.config.clone() };
        let options = WorldOptions::new(1)
            .env(config)
            .max_episode_steps(take.limit)
            .frame_skip(take.frame_skip)
            .threads(1);
        let mut world = World::new(take.entry, options)?;
        world.set_policy(policy::scripted(take.actors.clone(), |_, _| Ok(())));
        let options = ResetOptions { seed: Some(take.seed), ..take.options.clone() };
        let rollout = Rollout::new(held..held + 1).seed(take.run_seed).options(options);
        let mut sink = Continued { writer: writer.as_mut(), columns };
        let mut end = End::default();
        let mut watch = (DatasetRecorder::new(&mut sink), &mut end);
        let mut run = world.begin(&rollout, &mut watch)?;
        for action in &take.actions {
            if run.needs_actions().is_none() {
                break;
            }
            run.set_actions(action.as_slice())?;
            run.advance()?;
        }
        match end.0 {
            Some(end) if end.steps == take.end.steps && end.success == take.end.success => Ok(held + 1),
            end => Err(format!(
                "the episode was not repeated as it was played ({end:?}, not {:?}); the environment is not deterministic",
                take.end
            )
            .into()),
        }
    }
}

fn append() -> WriteOptions {
    WriteOptions::default().mode(WriteMode::Append)
}

/// How the repetition ended.
#[derive(Default)]
struct End(Option<Ending>);

impl Recorder for End {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.0 = Some(end.into());
        Ok(())
    }
}

/// A file that may hold factors that this episode does not vary.
struct Continued<'a> {
    writer: &'a mut dyn DatasetWriter,
    columns: Vec<String>,
}

impl EpisodeSink for Continued<'_> {
    fn begin(&mut self, schema: &std::sync::Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        self.writer.begin(schema, metadata)
    }

    fn holds(&self, column: &str) -> bool {
        self.columns.iter().any(|held| held == column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.writer.write_episode(rows)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.writer.finish()
    }
}
