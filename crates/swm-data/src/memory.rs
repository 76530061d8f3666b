//! A dataset in memory: whole episodes as tables, shared by all handles. What a replay buffer gives to a loader, and
//! what tests record into. Nothing here grows or is written to a file.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Batch, Metadata, Schema, SliceMut};

use crate::dataset::{Dataset, DatasetInfo, Steps, copy_rows};
use crate::error::DataError;

/// Episodes in memory. Handles share them.
#[derive(Clone, Debug)]
pub struct MemoryDataset {
    info: DatasetInfo,
    episodes: Arc<[Arc<Batch>]>,
}

impl MemoryDataset {
    /// Takes episodes (row = step) of one schema. `name` stands for the path in messages.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`]: an episode has another schema.
    pub fn new(
        name: &str,
        schema: Arc<Schema>,
        metadata: Option<Metadata>,
        episodes: impl IntoIterator<Item = Arc<Batch>>,
    ) -> Result<Self, DataError> {
        let episodes: Arc<[Arc<Batch>]> = episodes.into_iter().collect();
        if let Some(odd) = episodes.iter().position(|episode| episode.schema() != &schema) {
            return Err(DataError::request(
                Path::new(name),
                format!("episode {odd} has other columns than the dataset"),
            ));
        }
        let lengths = episodes.iter().map(|episode| episode.rows()).collect();
        let mut info = DatasetInfo::new(Path::new(name), "memory", schema, lengths);
        info.runs = metadata.map(|metadata| (0, metadata)).into_iter().collect();
        Ok(Self { info, episodes })
    }
}

impl Dataset for MemoryDataset {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        copy_rows(self.episodes[episode].column(column), self.info.field(column).dim(), steps, out);
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(self.clone())
    }
}
