//! Columns of two datasets of the same episodes side by side: embeddings computed later, say, beside the recording.

use std::sync::Arc;

use swm_core::{Schema, SliceMut};

use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;

/// The columns of two datasets as one. Where both have a column, the first one's is taken.
pub struct Columns {
    first: Box<dyn Dataset>,
    second: Box<dyn Dataset>,
    info: DatasetInfo,
    /// For every column behind those of the first dataset, its position in the second.
    added: Arc<[usize]>,
}

impl Columns {
    /// Joins two datasets with episodes of equal lengths.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`]: another number of episodes, or one of another length.
    pub fn new(first: Box<dyn Dataset>, second: Box<dyn Dataset>) -> Result<Self, DataError> {
        let refuse = |reason| Err(DataError::request(second.path(), reason));
        let (here, there) = (first.num_episodes(), second.num_episodes());
        if here != there {
            return refuse(format!("it has {there} episodes, {} has {here}", first.path().display()));
        }
        let unequal = (0..here).find(|&episode| first.episode_len(episode) != second.episode_len(episode));
        if let Some(episode) = unequal {
            return refuse(format!(
                "episode {episode} has {} rows, in {} it has {}",
                second.episode_len(episode),
                first.path().display(),
                first.episode_len(episode)
            ));
        }
        let new = second.schema().fields().iter().enumerate();
        let new = new.filter(|(_, field)| first.schema().index(&field.name).is_none());
        let (added, fields): (Vec<_>, Vec<_>) = new.map(|(column, field)| (column, field.clone())).unzip();
        let all = first.schema().fields().iter().cloned().chain(fields).collect();
        let schema = Schema::new(all).map_err(|error| DataError::request(first.path(), error.to_string()))?;
        let info = first.info().with_schema(schema);
        Ok(Self { first, second, info, added: added.into() })
    }
}

impl Dataset for Columns {
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
        let own = self.first.schema().fields().len();
        match column.checked_sub(own).and_then(|added| self.added.get(added)) {
            Some(&there) => self.second.rows(there, episode, steps, out),
            None => self.first.rows(column, episode, steps, out),
        }
    }

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        self.first.dress(key)?;
        self.second.dress(key)
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.first.origin()?.and(self.second.origin()?).with(format_args!("columns {:?}", self.added)))
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        self.first.check_whole()?;
        self.second.check_whole()
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        self.first.check_episode(episode)?;
        self.second.check_episode(episode)
    }

    fn share(&self) -> Box<dyn Dataset> {
        let Self { first, second, info, added } = self;
        let (info, added) = (info.clone(), added.clone());
        Box::new(Self { first: first.share(), second: second.share(), info, added })
    }
}
