//! Datasets: recorded frames to HDF5, and random windows of them.

use std::path::Path;
use std::sync::Arc;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use swm_benches::{Actions, EPISODE_STEPS, Image, world};
use swm_core::error::BoxError;
use swm_core::{Batch, EpisodeSink, Metadata, Rollout, Schema};
use swm_data::WriteMode;
use swm_data::loader::{BatchOptions, ClipOptions, Loader};

/// Keeps what it is given, so that writing can be timed without simulating.
#[derive(Default)]
struct Memory {
    schema: Option<Arc<Schema>>,
    metadata: Metadata,
    episodes: Vec<Batch>,
}

impl EpisodeSink for Memory {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        (self.schema, self.metadata) = (Some(Arc::clone(schema)), metadata.clone());
        Ok(0)
    }

    fn holds(&self, _column: &str) -> bool {
        false
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.episodes.push(rows.clone());
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Episodes of the weak policy, as `swm collect` records them.
fn recorded(image: Image, episodes: u64, steps: usize) -> Memory {
    let mut memory = Memory::default();
    let mut world = world(image, Actions::Weak, 1, 1).expect("the options are valid");
    world.set_max_episode_steps(Some(steps as u64));
    let rollout = Rollout::new(0..episodes);
    world.record_dataset(&rollout, &mut memory).expect("memory takes everything");
    memory
}

fn write(path: &Path, recorded: &Memory) {
    let mut writer = swm_data::create(path, WriteMode::Overwrite, None).expect("the folder is writable");
    let schema = recorded.schema.as_ref().expect("it was recorded");
    writer.begin(schema, &recorded.metadata).expect("the columns are storable");
    for rows in &recorded.episodes {
        writer.write_episode(rows).expect("the disk has room");
    }
    writer.finish().expect("the disk has room");
}

/// An episode of 10 steps without images into a file that holds many already: the cost must not grow with the file.
fn growing_file(c: &mut Criterion) {
    let mut group = c.benchmark_group("growing_file");
    let recorded = recorded(Image::NONE, 1, 10);
    let rows = &recorded.episodes[0];
    for name in ["file.h5", "file.mcap", "file.folder"] {
        for before in [0, 10_000] {
            let folder = tempfile::tempdir().expect("the disk has room");
            let mut writer = swm_data::create(&folder.path().join(name), WriteMode::Overwrite, None)
                .expect("the folder is writable");
            writer
                .begin(recorded.schema.as_ref().expect("it was recorded"), &recorded.metadata)
                .expect("the columns are storable");
            (0..before).for_each(|_| writer.write_episode(rows).expect("the disk has room"));
            group.bench_function(format!("{name}/after={before}"), |b| {
                b.iter(|| writer.write_episode(rows).expect("the disk has room"));
            });
            writer.finish().expect("the disk has room");
        }
    }
    group.finish();
}

/// Frames per second into a new file, opening and clean end included.
fn hdf5_write(c: &mut Criterion) {
    let mut group = c.benchmark_group("hdf5_write");
    group.sample_size(10);
    for side in [64, 224] {
        let recorded = recorded(Image { side, style: "fast" }, 4, EPISODE_STEPS);
        let rows = recorded.episodes.iter().map(Batch::rows).sum::<usize>();
        group.throughput(Throughput::Elements(rows as u64));
        group.bench_function(format!("frames_{side}"), |b| {
            let folder = || tempfile::tempdir().expect("the system has a temporary folder");
            // The folder goes back to the harness, which drops it outside of the timed region.
            b.iter_batched_ref(
                folder,
                |folder| write(&folder.path().join("frames.h5"), &recorded),
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

/// Batches of 16 shuffled clips of 4 frames, 5 steps apart, with actions and states.
fn hdf5_windows(c: &mut Criterion) {
    const CLIPS: usize = 16;
    let mut group = c.benchmark_group("hdf5_windows");
    group.sample_size(20).throughput(Throughput::Elements(CLIPS as u64));
    let folder = tempfile::tempdir().expect("the system has a temporary folder");
    for side in [64, 224] {
        let path = folder.path().join(format!("{side}.h5"));
        write(&path, &recorded(Image { side, style: "fast" }, 8, EPISODE_STEPS));
        for threads in [1, 2] {
            let keys = ["pixels", "action", "proprio"].map(str::to_owned).to_vec();
            let options =
                ClipOptions::default().num_steps(4).frameskip(5).keys(Some(keys)).threads(Some(threads));
            let dataset = swm_data::open(&path).expect("it was written above");
            let loader = Loader::new(dataset, &options).expect("the options fit the file");
            let stream = BatchOptions::default().size(CLIPS).shuffle(Some(1)).drop_last(true);
            let mut batches = loader.batches(&stream).expect("there are more clips");
            let mut batch = batches.new_batch();
            group.bench_function(format!("clips_{side}/threads={threads}"), |b| {
                b.iter(|| {
                    // The end of an epoch gives no batch.
                    while !batches.next_batch(&mut batch).expect("the file is whole") {}
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, growing_file, hdf5_write, hdf5_windows);
criterion_main!(benches);
