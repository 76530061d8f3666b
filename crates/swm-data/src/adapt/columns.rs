//! Columns of two datasets of the same episodes side by side: embeddings computed later, say, beside the recording.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSource, Metadata, Schema, SliceMut};

use crate::dataset::{Dataset, Steps, read_rows};
use crate::error::DataError;

/// The columns of two datasets as one. Where both have a column, the first one's is taken.
pub struct Columns {
    first: Box<dyn Dataset>,
    second: Box<dyn Dataset>,
    schema: Arc<Schema>,
    /// For every column behind those of the first dataset, its position in the second.
    added: Arc<[usize]>,
}

impl Columns {
    /// Joins two datasets with episodes of equal lengths.
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
        Ok(Self { first, second, schema, added: added.into() })
    }
}

impl EpisodeSource for Columns {
    fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    fn num_episodes(&self) -> usize {
        self.first.num_episodes()
    }

    fn episode_len(&self, episode: usize) -> usize {
        self.first.episode_len(episode)
    }

    fn metadata(&self) -> Option<&Metadata> {
        self.first.metadata()
    }

    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        Ok(read_rows(self, episode, rows, out)?)
    }
}

impl Dataset for Columns {
    fn path(&self) -> &Path {
        self.first.path()
    }

    fn format(&self) -> &'static str {
        self.first.format()
    }

    fn read_column(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let own = self.first.schema().fields().len();
        match column.checked_sub(own).and_then(|added| self.added.get(added)) {
            Some(&there) => self.second.read_column(there, episode, steps, out),
            None => self.first.read_column(column, episode, steps, out),
        }
    }

    fn share(&self) -> Box<dyn Dataset> {
        let Self { first, second, schema, added } = self;
        let (schema, added) = (schema.clone(), added.clone());
        Box::new(Self { first: first.share(), second: second.share(), schema, added })
    }

    fn runs(&self) -> &[(u64, Metadata)] {
        self.first.runs()
    }

    fn skipped(&self) -> &[(String, String)] {
        self.first.skipped()
    }
}
