//! A loader used by several processes, threads and owners of memory.

use std::collections::BTreeSet;
use std::path::Path;

use swm_core::{Batch, RowsMut, Schema};
use swm_data::loader::{BatchOptions, ClipOptions, GoalOptions, Loader, Position, Table};
use swm_data::{RenderOptions, WriteMode, WriteOptions};

use crate::support::record;
use crate::{FORMATS, open};

fn loader(path: &Path) -> Loader {
    let options = ClipOptions::default().num_steps(2).keys(Some(vec!["state".to_owned()])).threads(Some(2));
    Loader::new(open(path).unwrap(), &options).unwrap()
}

#[test]
fn shards_are_disjoint_and_equally_long_parts_of_every_epoch() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..3).unwrap();
    let loader = loader(&path);
    let options = BatchOptions::default().size(3).shuffle(Some(5)).epochs(Some(2));
    let clips = |rank, world| {
        let mut found = Vec::new();
        let mut batches = loader.batches(&options.shard(rank, world)).unwrap();
        for _epoch in 0..2 {
            for batch in &mut batches {
                let batch = batch.unwrap();
                let width = batch.schema().dim(0);
                found
                    .extend(batch.get::<f64>("state").unwrap().chunks(width).map(|clip| format!("{clip:?}")));
            }
        }
        found
    };
    let whole = clips(0, 1);
    for world in [2, 3, 4] {
        let parts: Vec<_> = (0..world).map(|rank| clips(rank, world)).collect();
        let per_epoch = loader.len() / world;
        assert!(parts.iter().all(|part| part.len() == 2 * per_epoch));
        for epoch in 0..2 {
            let here = |part: &Vec<String>| part[epoch * per_epoch..][..per_epoch].to_vec();
            let all: BTreeSet<_> = parts.iter().flat_map(here).collect();
            assert_eq!(all.len(), world * per_epoch);
            // Rank by rank, they are the order of one process.
            let first = &whole[epoch * loader.len()..][..loader.len()];
            assert!((0..per_epoch).all(|at| here(&parts[1])[at] == first[at * world + 1]));
        }
    }
    let refused = |rank, world| loader.batches(&options.shard(rank, world)).err().unwrap().to_string();
    assert!(refused(2, 2).contains("rank 2 of 2") && refused(0, 0).contains("`shard`"));
    assert!(refused(0, loader.len() + 1).contains("too few"));
    let position = loader.batches(&options.shard(0, 2)).unwrap().position();
    assert!(loader.batches_from(&options.shard(0, 2), &position).is_ok());
    assert!(loader.batches_from(&options.shard(1, 2), &position).is_err());
    // Positions that were written before there were shards.
    let text = r#"{"epoch": 1, "clip": 3, "shuffle": 5, "clips": 9}"#;
    let old: Position = serde_json::from_str(text).unwrap();
    assert_eq!(old.shard, (0, 1));
    assert!(!serde_json::to_string(&old).unwrap().contains("shard"));
}

#[test]
fn several_threads_read_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..3).unwrap();
    let loader = loader(&path);
    let read = |clips: &[usize]| {
        let mut batch = loader.new_batch();
        loader.read(clips, &mut batch).unwrap();
        batch
    };
    let wanted: Vec<Vec<usize>> =
        (0..8).map(|at| (0..5).map(|k| (at * 3 + k) % loader.len()).collect()).collect();
    let expected: Vec<Batch> = wanted.iter().map(|clips| read(clips)).collect();
    let read = &read;
    std::thread::scope(|scope| {
        for (clips, expected) in wanted.iter().zip(&expected) {
            scope.spawn(move || (0..20).for_each(|_| assert_eq!(&read(clips), expected)));
        }
    });
}

/// Memory of a fixed size, of which the last batch uses a part.
struct Fixed {
    batch: Batch,
    capacity: usize,
}

impl Table for Fixed {
    fn schema(&self) -> &Schema {
        self.batch.schema()
    }

    fn resize(&mut self, rows: usize) {
        assert!(rows <= self.capacity);
        self.batch.resize(rows);
    }

    fn rows_mut(&mut self) -> RowsMut<'_> {
        self.batch.rows_mut()
    }
}

#[test]
fn tables_of_the_callers_making_are_filled() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..3).unwrap();
    let loader = loader(&path);
    let options = BatchOptions::default().size(4).epochs(Some(1));
    let table = || Fixed { batch: loader.new_batch(), capacity: 4 };
    let mut filled = loader.batches_into(&options, None, table).unwrap();
    let mut mine = table();
    for expected in loader.batches(&options).unwrap() {
        assert!(filled.next_batch(&mut mine).unwrap());
        assert_eq!(mine.batch, expected.unwrap());
    }
    assert!(!filled.next_batch(&mut mine).unwrap());
    loader.read(&[1], &mut mine).unwrap();
    assert_eq!(mine.batch.rows(), 1);
}

#[test]
fn datasets_open_again_from_their_path() {
    let folder = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        record(&path, WriteMode::Append, 0..2).unwrap();
        let dataset = open(&path).unwrap().share();
        let again = open(dataset.path()).unwrap();
        assert_eq!(again.info().format, dataset.info().format);
        assert_eq!(
            (&again.info().schema, &again.info().lengths),
            (dataset.schema(), &dataset.info().lengths)
        );
        assert_eq!(again.info().runs, dataset.info().runs);
    }
}

#[test]
fn every_option_has_a_method() {
    let goals = GoalOptions::default().gamma(0.9).offset(Some(1)).seed(3);
    assert_eq!((goals.gamma, goals.offset, goals.seed), (0.9, Some(1), 3));
    let clips = ClipOptions::default().frameskip(2).goals(Some(goals.clone()));
    assert_eq!((clips.frameskip, clips.goals), (2, Some(goals)));
    let batches = BatchOptions::default().drop_last(true).ahead(5);
    assert_eq!((batches.drop_last, batches.ahead, batches.shard), (true, 5, (0, 1)));
    let write = WriteOptions::default().mode(WriteMode::Error).frames_per_second(Some(10.0));
    assert_eq!((write.mode, write.frames_per_second), (WriteMode::Error, Some(10.0)));
    assert!(!RenderOptions::default().verify(false).verify);
}
