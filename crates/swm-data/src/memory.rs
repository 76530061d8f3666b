//! A dataset in memory: whole episodes as tables, shared by all handles. What a replay buffer gives to a loader, and
//! what tests record into. Nothing here grows or is written to a file.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSource, Metadata, Schema, SliceMut};

use crate::dataset::{Dataset, Steps, check_request, copy_rows, locate, read_rows};
use crate::error::DataError;

/// Episodes in memory. Handles share them.
#[derive(Clone, Debug)]
pub struct MemoryDataset {
    name: PathBuf,
    schema: Arc<Schema>,
    runs: Arc<[(u64, Metadata)]>,
    episodes: Arc<[Arc<Batch>]>,
}

impl MemoryDataset {
    /// Takes episodes (row = step) of one schema. `name` stands for the path in messages.
    pub fn new(
        name: &str,
        schema: Arc<Schema>,
        metadata: Option<Metadata>,
        episodes: impl IntoIterator<Item = Arc<Batch>>,
    ) -> Result<Self, DataError> {
        let name = PathBuf::from(name);
        let episodes: Arc<[Arc<Batch>]> = episodes.into_iter().collect();
        if let Some(odd) = episodes.iter().position(|episode| episode.schema() != &schema) {
            return Err(DataError::request(
                &name,
                format!("episode {odd} has other columns than the dataset"),
            ));
        }
        Ok(Self {
            name,
            schema,
            runs: metadata.map(|metadata| (0, metadata)).into_iter().collect(),
            episodes,
        })
    }
}

impl EpisodeSource for MemoryDataset {
    fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    fn num_episodes(&self) -> usize {
        self.episodes.len()
    }

    fn episode_len(&self, episode: usize) -> usize {
        self.episodes.get(episode).map_or(0, |rows| rows.rows())
    }

    fn metadata(&self) -> Option<&Metadata> {
        self.runs.first().map(|(_, metadata)| metadata)
    }

    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        Ok(read_rows(self, episode, rows, out)?)
    }
}

impl Dataset for MemoryDataset {
    fn path(&self) -> &Path {
        &self.name
    }

    fn format(&self) -> &'static str {
        "memory"
    }

    fn read_column(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let (field, len) = locate(self, column, episode)?;
        check_request(&self.name, field, episode, len, steps, &out)?;
        copy_rows(self.episodes[episode].column(column), field.width(), steps, out);
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(self.clone())
    }

    fn runs(&self) -> &[(u64, Metadata)] {
        &self.runs
    }
}
