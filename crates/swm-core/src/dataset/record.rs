//! Recording: the recorder that hands whole episodes to a sink, in the order of their index.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::Metadata;
use super::queue::{Beside, Queue};
use super::sink::{AtOnce, EpisodeSink, Output};
use crate::batch::{Batch, Field, Schema};
use crate::env::{ResetOptions, VARIATION_PREFIX};
use crate::error::{BoxError, WorldError};
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, Rollout, RunInfo};
use crate::world::World;

/// A recorder that hands whole episodes to a sink, in the order of their index, whatever the order in which they
/// end.
pub struct DatasetRecorder<'a> {
    output: Box<dyn Output + 'a>,
    schema: Arc<Schema>,
    /// For every column of the dataset, its position in the infos.
    from: Vec<usize>,
    /// Episodes that run or wait for an earlier one.
    open: BTreeMap<u64, Buffered>,
    next: u64,
}

struct Buffered {
    rows: Batch,
    complete: bool,
}

impl<'a> DatasetRecorder<'a> {
    /// Records into `sink`, on the thread of the run: when an episode's end is seen, all before it are safe.
    pub fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self::with(AtOnce::new(sink))
    }

    fn with(output: impl Output + 'a) -> Self {
        let schema = Arc::new(Schema::default());
        Self { output: Box::new(output), schema, from: Vec::new(), open: BTreeMap::new(), next: 0 }
    }

    /// The columns of the dataset: all infos, except those that the world was told to leave out, and factors that
    /// were neither sampled nor set, and of which the dataset has no column yet.
    fn choose_columns(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        let varied = varied_factors(run);
        let unrecorded = &run.options.unrecorded;
        let wanted = |field: &Field| match field.name.strip_prefix(VARIATION_PREFIX) {
            _ if unrecorded.contains(&field.name) => false,
            Some(factor) => varied.contains(factor) || self.output.holds(&field.name),
            None => true,
        };
        let fields = run.schema.fields().iter().enumerate().filter(|(_, field)| wanted(field));
        let (from, fields): (Vec<_>, Vec<_>) = fields.map(|(index, field)| (index, field.clone())).unzip();
        self.schema = Schema::new(fields)?;
        self.from = from;
        Ok(())
    }
}

/// The factors that a run samples or sets.
fn varied_factors(run: &RunInfo<'_>) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut add = |options: &ResetOptions| {
        for factor in &run.spec.factors {
            let sampled = match &options.variation {
                None => factor.sampled_by_default,
                Some(list) => list.iter().any(|asked| factor.is_selected_by(asked)),
            };
            if sampled || options.variation_values.contains_key(&factor.name) {
                names.insert(factor.name.clone());
            }
        }
    };
    run.rollout.all_options().iter().for_each(&mut add);
    names
}

impl Recorder for DatasetRecorder<'_> {
    fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
        self.choose_columns(run)?;
        self.next = run.rollout.episodes.start;
        let held = self.output.begin(&self.schema, &Metadata::of(run))?;
        if held != self.next {
            let next = self.next;
            return Err(
                format!("the dataset holds {held} episodes, so {held} must come next, not {next}").into()
            );
        }
        Ok(())
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let buffered = self.open.entry(row.episode.index).or_insert_with(|| {
            let mut rows = self.output.spare().unwrap_or_else(|| Batch::new(self.schema.clone(), 0));
            rows.clear();
            Buffered { rows, complete: false }
        });
        Ok(buffered.rows.push_row(row.values, &self.from)?)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        if let Some(buffered) = self.open.get_mut(&end.index) {
            buffered.complete = true;
        }
        while self.open.get(&self.next).is_some_and(|buffered| buffered.complete) {
            let Some(buffered) = self.open.remove(&self.next) else { break };
            self.output.write(buffered.rows)?;
            self.next += 1;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.output.finish()
    }
}

impl World {
    /// Records the episodes of `rollout` into `sink`, in the order of their index. With several threads, one of them writes
    /// while others step.
    ///
    /// # Errors
    ///
    /// As [`World::run`], and what writing meets; episodes that were committed before are safe.
    pub fn record_dataset(
        &mut self,
        rollout: &Rollout,
        sink: &mut dyn EpisodeSink,
    ) -> Result<(), WorldError> {
        self.record_dataset_with(rollout, sink, &mut ())
    }

    /// As [`World::record_dataset`], watched by another recorder too. It may see the end of an episode before that is safe.
    ///
    /// # Errors
    ///
    /// As [`World::record_dataset`], and whatever `recorder` meets.
    pub fn record_dataset_with(
        &mut self,
        rollout: &Rollout,
        sink: &mut dyn EpisodeSink,
        recorder: &mut dyn Recorder,
    ) -> Result<(), WorldError> {
        if self.threads.is_one() {
            return self.run(rollout, &mut (DatasetRecorder::new(sink), recorder));
        }
        let queue = Queue::new(sink);
        let threads = self.threads.clone();
        threads.install(|| {
            rayon::in_place_scope(|scope| {
                let beside = DatasetRecorder::with(Beside { queue: &queue, scope });
                self.run(rollout, &mut (beside, recorder))
            })
        })
    }
}
