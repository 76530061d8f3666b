//! Recording: the recorder that hands whole episodes to a sink, in the order of their index.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::queue::{Queue, QueuedOutput};
use super::sink::{DirectOutput, EpisodeSink, Output};
use super::{EncodedBatch, Metadata, RowEncoder};
use crate::batch::{Field, Schema};
use crate::env::{ResetOptions, VARIATION_PREFIX};
use crate::error::{BoxError, WorldError};
use crate::recorder::{LiveStep, Recorder};
use crate::run::{EpisodeEnd, Rollout, RunInfo};
use crate::world::{RecorderShard, SharedRecorder, SplitRecorder, World};

/// A recorder that hands whole episodes to a sink, in the order of their index, whatever the order in which they
/// end.
pub struct DatasetRecorder<'a> {
    output: Box<dyn Output + 'a>,
    schema: Arc<Schema>,
    /// For every column of the dataset, its position in the infos.
    from: Vec<usize>,
    /// Columns whose rows are encoded as they come, by position in the dataset.
    encoded: Vec<usize>,
    /// Episodes that run.
    open: BTreeMap<u64, Buffered>,
    /// Encoders of episodes that are over.
    spare: Vec<Vec<Box<dyn RowEncoder>>>,
}

struct Buffered {
    rows: EncodedBatch,
    /// One for each encoded column of `rows`.
    encoders: Vec<Box<dyn RowEncoder>>,
}

impl<'a> DatasetRecorder<'a> {
    /// Records into `sink`, on the thread of the run: when an episode's end is seen, all before it are safe.
    pub fn new(sink: &'a mut dyn EpisodeSink) -> Self {
        Self::with(Box::new(DirectOutput::new(sink)))
    }

    fn with(output: Box<dyn Output + 'a>) -> Self {
        Self {
            output,
            schema: Arc::new(Schema::default()),
            from: Vec::new(),
            encoded: Vec::new(),
            open: BTreeMap::new(),
            spare: Vec::new(),
        }
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

    /// The rows of an episode that begins.
    fn begun(&mut self) -> Buffered {
        let is_encoded = |column| self.encoded.contains(&column);
        let mut rows = self.output.spare().unwrap_or_else(|| EncodedBatch::new(&self.schema, is_encoded));
        rows.clear();
        let encoders = self.spare.pop().unwrap_or_else(|| self.encoders());
        Buffered { rows, encoders }
    }

    fn encoders(&self) -> Vec<Box<dyn RowEncoder>> {
        self.encoded.iter().filter_map(|&column| self.output.row_encoder(column)).collect()
    }
}

/// The factors that a run samples or sets.
fn varied_factors(run: &RunInfo<'_>) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut add = |options: &ResetOptions| {
        for factor in &run.spec.factors {
            let sampled = factor.is_sampled(options.variation.as_deref());
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
        let next = run.rollout.episodes.start;
        let held = self.output.begin(&self.schema, &Metadata::of(run))?;
        if held != next {
            return Err(
                format!("the dataset holds {held} episodes, so {held} must come next, not {next}").into()
            );
        }
        let columns = 0..self.schema.fields().len();
        let encoders = columns.filter_map(|column| Some((column, self.output.row_encoder(column)?)));
        let (encoded, encoders) = encoders.unzip();
        // Those of the first episode.
        (self.encoded, self.spare) = (encoded, vec![encoders]);
        Ok(())
    }

    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let index = row.episode.index;
        if !self.open.contains_key(&index) {
            let begun = self.begun();
            self.open.insert(index, begun);
        }
        let Some(Buffered { rows, encoders }) = self.open.get_mut(&index) else { return Ok(()) };
        Ok(rows.push_row(row.values, &self.from, encoders)?)
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        let Some(Buffered { rows, encoders }) = self.open.remove(&end.index) else { return Ok(()) };
        self.spare.push(encoders);
        self.output.write(end.index, rows)
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.output.finish()
    }
}

impl SplitRecorder for DatasetRecorder<'_> {
    fn shard(&self) -> Option<Box<dyn RecorderShard + '_>> {
        let mut shard = DatasetRecorder {
            output: self.output.part()?,
            schema: Arc::clone(&self.schema),
            from: self.from.clone(),
            encoded: self.encoded.clone(),
            open: BTreeMap::new(),
            spare: Vec::new(),
        };
        // While an episode is written, a sink cannot be asked for them.
        shard.spare.push(shard.encoders());
        Some(Box::new(shard))
    }
}

impl RecorderShard for DatasetRecorder<'_> {
    fn has_room(&self) -> bool {
        self.output.has_room()
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
        let recorder = SharedRecorder::new(recorder);
        if self.threads.is_one() {
            return self.run_split(rollout, &mut (DatasetRecorder::new(sink), recorder));
        }
        let queue = Queue::new(sink);
        self.record_queued(rollout, &queue, recorder)
    }

    /// Records through `queue`, which the world's threads empty.
    pub(super) fn record_queued<'a>(
        &mut self,
        rollout: &Rollout,
        queue: &'a Queue<'a>,
        recorder: SharedRecorder<'_>,
    ) -> Result<(), WorldError> {
        let threads = self.threads.clone();
        threads.install(|| {
            rayon::in_place_scope(|scope| {
                let episodes = DatasetRecorder::with(Box::new(QueuedOutput::new(queue, scope)));
                self.run_split(rollout, &mut (episodes, recorder))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Batch;
    use crate::dataset::{EncodedRow, EncodedRows};
    use crate::policies;
    use crate::run::WorldOptions;
    use crate::testing::TOY;

    const SIDE: usize = 64;

    /// Keeps the images of every episode, as values or encoded.
    #[derive(Default)]
    struct Kept {
        encodes: bool,
        image: usize,
        episodes: Vec<Vec<Vec<u8>>>,
    }

    /// Stores the complement of every byte.
    struct Complement;

    impl RowEncoder for Complement {
        fn encode(&mut self, row: &[u8], out: &mut EncodedRows) {
            let bytes: Vec<u8> = row.iter().map(|byte| !byte).collect();
            out.push(EncodedRow { bytes: &bytes, is_compressed: true });
        }
    }

    impl EpisodeSink for Kept {
        fn begin(&mut self, schema: &Arc<Schema>, _metadata: &Metadata) -> Result<u64, BoxError> {
            self.image = schema.require("pixels")?;
            Ok(0)
        }

        fn holds(&self, _column: &str) -> bool {
            false
        }

        fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
            assert!(!self.encodes, "the images are encoded");
            let images = rows.get::<u8>("pixels")?.chunks(SIDE * SIDE * 3);
            self.episodes.push(images.map(<[u8]>::to_vec).collect());
            Ok(())
        }

        fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
            (self.encodes && column == self.image).then(|| Box::new(Complement) as _)
        }

        fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
            let [(column, images)] = &rows.encoded[..] else { return self.write_episode(&rows.plain) };
            assert_eq!((*column, images.len()), (self.image, rows.rows()));
            assert!(rows.plain.schema().index("pixels").is_none() && rows.plain.get::<f64>("state").is_ok());
            self.episodes
                .push(images.iter().map(|row| row.bytes.iter().map(|byte| !byte).collect()).collect());
            Ok(())
        }

        fn finish(&mut self) -> Result<(), BoxError> {
            Ok(())
        }
    }

    #[test]
    fn rows_that_are_encoded_as_they_come_are_those_of_the_episodes() {
        let record = |threads, encodes| {
            let options = WorldOptions::new(7).threads(threads).max_episode_steps(6).image(SIDE, SIDE);
            let mut world = World::new(&TOY, options).unwrap();
            world.set_policy(policies::random()).unwrap();
            let mut kept = Kept { encodes, ..Kept::default() };
            world.record_dataset(&Rollout::new(0..20).seed(5), &mut kept).unwrap();
            kept.episodes
        };
        let plain = record(1, false);
        assert_eq!(plain.len(), 20);
        for (threads, encodes) in [(3, false), (1, true), (3, true)] {
            assert!(record(threads, encodes) == plain, "{threads} threads, encoded: {encodes}");
        }
    }
}
