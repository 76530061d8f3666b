//! Datasets end to end: the episodes of the first, then those of the next. Formats may differ, columns may not.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Metadata, Schema, SliceMut};

use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;
use crate::recording::EP_IDX;

/// Several datasets as one.
pub struct Concat {
    parts: Vec<Part>,
    info: DatasetInfo,
}

struct Part {
    dataset: Box<dyn Dataset>,
    /// Its first episode here.
    first: usize,
    /// For every column here, its position in this part.
    columns: Arc<[usize]>,
}

impl Concat {
    /// Joins datasets. The columns are those that all have, in the order of the first.
    ///
    /// # Errors
    ///
    /// No datasets, no column that all have, or one that they hold in different types or shapes.
    pub fn new(datasets: Vec<Box<dyn Dataset>>) -> Result<Self, DataError> {
        let Some(head) = datasets.first() else {
            return Err(DataError::Loader {
                setting: "concat",
                reason: "no datasets; give one or more".to_owned(),
            });
        };
        let everywhere = |name: &str| datasets.iter().all(|dataset| dataset.schema().index(name).is_some());
        let shared: Vec<_> =
            head.schema().fields().iter().filter(|field| everywhere(&field.name)).cloned().collect();
        if shared.is_empty() {
            return Err(DataError::request(head.path(), "it has no column that all of the datasets have"));
        }
        let schema =
            Schema::new(shared).map_err(|error| DataError::request(head.path(), error.to_string()))?;
        let (path, format) = (head.path().to_owned(), head.info().format);
        let (mut parts, mut runs, mut lengths) = (Vec::with_capacity(datasets.len()), Vec::new(), Vec::new());
        for dataset in datasets {
            let mut columns = Vec::with_capacity(schema.fields().len());
            for field in schema.fields() {
                let column = dataset.schema().index(&field.name).expect("every dataset has it");
                let there = &dataset.schema().fields()[column];
                if (there.dtype, &there.shape) != (field.dtype, &field.shape) {
                    let reason = format!(
                        "column `{}` holds {} {:?}, in the first dataset {} {:?}",
                        field.name, there.dtype, there.shape, field.dtype, field.shape
                    );
                    return Err(DataError::request(dataset.path(), reason));
                }
                columns.push(column);
            }
            let first = lengths.len();
            runs.extend(dataset.info().runs.iter().map(|(at, run)| (at + first as u64, run.clone())));
            lengths.extend(dataset.info().lengths.iter());
            parts.push(Part { dataset, first, columns: columns.into() });
        }
        let mut info = DatasetInfo::new(&path, format, schema, lengths);
        info.runs = runs.into();
        info.has_checksums = parts.iter().all(|part| part.dataset.info().has_checksums);
        Ok(Self { parts, info })
    }

    /// Gives the whole a path and a record of runs of its own.
    pub(crate) fn rename(&mut self, path: &Path, runs: Vec<(u64, Metadata)>) {
        self.info.path = path.into();
        self.info.runs = runs.into();
    }

    /// The part that holds an episode, and its number there.
    fn part(&self, episode: usize) -> (usize, usize) {
        // Parts without episodes share their `first` with the next one, which comes later.
        let part = self.parts.partition_point(|part| part.first <= episode) - 1;
        (part, episode - self.parts[part].first)
    }
}

impl Dataset for Concat {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        mut out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let number = episode;
        let (part, episode) = self.part(episode);
        if let (EP_IDX, SliceMut::I32(out)) = (self.info.field(column).name.as_str(), &mut out) {
            // Each part counts its episodes from 0.
            out.fill(i32::try_from(number).unwrap_or(i32::MAX));
            return Ok(());
        }
        let part = &mut self.parts[part];
        part.dataset.rows(part.columns[column], episode, steps, out)
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let (part, episode) = self.part(episode);
        self.parts[part].dataset.check_episode(episode)
    }

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        self.parts.iter_mut().try_for_each(|part| part.dataset.dress(key))
    }

    fn origin(&self) -> Option<Origin> {
        let of = |part: &Part| Some(part.dataset.origin()?.with(format_args!("columns {:?}", part.columns)));
        self.parts.iter().map(of).reduce(|all, part| Some(all?.and(part?))).flatten()
    }

    fn share(&self) -> Box<dyn Dataset> {
        let share = |part: &Part| Part {
            dataset: part.dataset.share(),
            first: part.first,
            columns: part.columns.clone(),
        };
        Box::new(Self { parts: self.parts.iter().map(share).collect(), info: self.info.clone() })
    }
}
