//! Datasets made of datasets hold what they are made of.

use std::sync::Arc;

use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::adapt::{Cached, Columns, Concat, Joined, Subset};
use swm_data::{Dataset, MemoryDataset, Steps};

use crate::support::{assert_same, episode, metadata, rows_of, schema};

fn memory(episodes: std::ops::Range<usize>) -> MemoryDataset {
    let schema = schema();
    let episodes = episodes.map(|index| Arc::new(episode(&schema, index, rows_of(index))));
    MemoryDataset::new("memory", schema.clone(), Some(metadata()), episodes).unwrap()
}

fn boxed(dataset: &MemoryDataset) -> Box<dyn Dataset> {
    dataset.share()
}

fn whole(dataset: &mut dyn Dataset, episode: usize) -> Batch {
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    dataset.read(episode, 0..dataset.episode_len(episode), &mut batch).unwrap();
    batch
}

#[test]
fn a_subset_has_the_chosen_episodes() {
    let mut all = memory(0..4);
    let mut subset = Subset::new(boxed(&all), &[3, 0]).unwrap();
    assert_eq!((subset.num_episodes(), subset.episode_len(0), subset.original(1)), (2, 17, Some(0)));
    assert_same(&whole(subset.share().as_mut(), 0), &whole(&mut all, 3));
    assert_same(&whole(&mut subset, 1), &whole(&mut all, 0));
    assert!(
        subset.read_column(0, 2, Steps { first: 0, count: 0, stride: 1 }, SliceMut::U8(&mut [])).is_err()
    );
    let message = Subset::new(boxed(&all), &[4]).err().unwrap().to_string();
    assert!(message.contains("no episode 4") && message.contains("holds 4"), "{message}");
}

#[test]
fn a_concatenation_has_all_episodes_and_runs() {
    let (mut first, mut second) = (memory(0..2), memory(2..4));
    let empty = memory(0..0);
    let mut both = Concat::new(vec![boxed(&empty), boxed(&first), boxed(&empty), boxed(&second)]).unwrap();
    assert_eq!(both.num_episodes(), 4);
    assert_same(&whole(&mut both, 1), &whole(&mut first, 1));
    assert_same(&whole(both.share().as_mut(), 2), &whole(&mut second, 0));
    let firsts: Vec<u64> = both.info().runs.iter().map(|(first, _)| *first).collect();
    assert_eq!(firsts, [0, 0, 2, 2]);
    assert!(Concat::new(Vec::new()).is_err());

    // Columns that not all have are left out; ones that differ are refused.
    let other = |dtype| {
        let fields = vec![Field::step("reward", dtype, &[]), Field::step("state", Dtype::F64, &[7])];
        let schema = Schema::new(fields).unwrap();
        MemoryDataset::new("other", schema.clone(), None, [Arc::new(Batch::new(schema, 3))]).unwrap()
    };
    let mut mixed = Concat::new(vec![boxed(&first), boxed(&other(Dtype::F64))]).unwrap();
    let names: Vec<_> = mixed.schema().fields().iter().map(|field| field.name.clone()).collect();
    assert_eq!(names, ["state", "reward"]);
    assert_eq!(whole(&mut mixed, 2).get::<f64>("state").unwrap(), [0.0; 21]);
    let message = Concat::new(vec![boxed(&first), boxed(&other(Dtype::F32))]).err().unwrap().to_string();
    assert!(message.contains("other") && message.contains("`reward` holds float32"), "{message}");
}

#[test]
fn columns_come_from_two_datasets_and_the_first_wins() {
    let first = memory(0..2);
    let schema =
        Schema::new(vec![Field::step("reward", Dtype::F64, &[]), Field::step("latent", Dtype::F32, &[2])])
            .unwrap();
    let rows = |episode: usize| Arc::new(episode_of(&schema, rows_of(episode)));
    let second = MemoryDataset::new("latents", schema.clone(), None, [rows(0), rows(1)]).unwrap();
    let mut both = Columns::new(boxed(&first), boxed(&second)).unwrap();
    assert_eq!(both.schema().fields().len(), first.schema().fields().len() + 1);
    let read = whole(both.share().as_mut(), 0);
    assert_eq!(read.get::<f32>("latent").unwrap()[..4], [0.0, 1.0, 2.0, 3.0]);
    let (ours, theirs) = (whole(&mut both, 0), whole(boxed(&first).as_mut(), 0));
    assert_eq!(ours.get::<f64>("reward").unwrap(), theirs.get::<f64>("reward").unwrap());
    let short = MemoryDataset::new("short", schema.clone(), None, [rows(1), rows(1)]).unwrap();
    let message = Columns::new(boxed(&first), boxed(&short)).err().unwrap().to_string();
    assert!(message.contains("short: episode 0 has 1 rows, in memory it has 5"), "{message}");
}

fn episode_of(schema: &Arc<Schema>, rows: usize) -> Batch {
    let mut batch = Batch::new(schema.clone(), rows);
    if let SliceMut::F32(values) = batch.column_mut(1) {
        values.iter_mut().enumerate().for_each(|(at, value)| *value = at as f32);
    }
    batch
}

#[test]
fn cached_columns_read_as_stored_ones() {
    let mut plain = memory(0..4);
    let mut cached = Cached::new(boxed(&plain), &["state", "task", "action"]).unwrap();
    for episode in 0..4 {
        assert_same(&whole(cached.share().as_mut(), episode), &whole(&mut plain, episode));
    }
    let column = cached.schema().require("state").unwrap();
    let steps = Steps { first: 4, count: 3, stride: 5 };
    let (mut a, mut b) = ([0.0; 21], [1.0; 21]);
    cached.read_column(column, 3, steps, SliceMut::F64(&mut a)).unwrap();
    plain.read_column(column, 3, steps, SliceMut::F64(&mut b)).unwrap();
    assert_eq!(a, b);
    assert!(cached.read_column(column, 3, Steps { first: 8, ..steps }, SliceMut::F64(&mut a)).is_err());
    assert!(
        Cached::new(boxed(&plain), &["states"]).err().unwrap().to_string().contains("did you mean `state`")
    );
}

#[test]
fn joined_columns_lie_side_by_side() {
    let plain = memory(0..1);
    let mut joined = Joined::new(boxed(&plain), "observation", &["state", "rew*"]).unwrap();
    let batch = whole(joined.share().as_mut(), 0);
    let (all, states, rewards) = (
        batch.get::<f64>("observation").unwrap(),
        batch.get::<f64>("state").unwrap(),
        batch.get::<f64>("reward").unwrap(),
    );
    for row in 0..5 {
        assert_eq!(all[row * 8..][..7], states[row * 7..][..7]);
        assert_eq!(all[row * 8 + 7], rewards[row]);
    }
    assert_eq!(joined.schema().fields().last().unwrap().shape, [8]);
    assert_same(&whole(&mut joined, 0), &batch);
    let refused = |parts: &[&str]| Joined::new(boxed(&plain), "x", parts).err().unwrap().to_string();
    assert!(refused(&["state", "action"]).contains("`action` float32"));
    assert!(refused(&["no*"]).contains("no column begins with `no`; there are: "));
    assert!(refused(&[]).contains("made of nothing"));
    assert!(Joined::new(boxed(&plain), "state", &["state"]).is_err());
}
