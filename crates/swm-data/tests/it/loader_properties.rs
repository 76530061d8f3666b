//! What must hold for every loader: on made-up datasets of any lengths, in memory.

use std::collections::BTreeMap;
use std::sync::Arc;

use proptest::prelude::*;
use swm_core::{Batch, Dtype, Field, Schema};
use swm_data::MemoryDataset;
use swm_data::adapt::split_episodes;
use swm_data::loader::{BatchOptions, Batches, ClipOptions, Clips, GoalOptions, Loader, Position};

/// Episodes whose rows say where they are.
fn dataset(lengths: &[usize]) -> MemoryDataset {
    let schema = Schema::new(vec![
        Field::step("ep", Dtype::I64, &[]),
        Field::step("row", Dtype::I64, &[1]),
        Field::step("action", Dtype::F32, &[2]),
    ])
    .unwrap();
    let episode = |(episode, &rows): (usize, &usize)| {
        let mut batch = Batch::new(schema.clone(), rows);
        for row in 0..rows {
            let mut all = batch.rows_mut();
            let out = all.select(row);
            out.write(0, &[episode as i64]);
            out.write(1, &[row as i64]);
            out.write(2, &[row as f32, -(row as f32)]);
        }
        Arc::new(batch)
    };
    let episodes: Vec<_> = lengths.iter().enumerate().map(episode).collect();
    MemoryDataset::new("made up", schema.clone(), None, episodes).unwrap()
}

/// The clips of a batch as (episode, rows, dense actions).
fn clips(batch: &Batch, num_steps: usize, frameskip: usize) -> Vec<(i64, Vec<i64>, Vec<f32>)> {
    let (episodes, rows) = (batch.get::<i64>("ep").unwrap(), batch.get::<i64>("row").unwrap());
    let actions = batch.get::<f32>("action").unwrap();
    let clip = |at: usize| {
        let episodes = &episodes[at * num_steps..][..num_steps];
        assert!(episodes.iter().all(|episode| *episode == episodes[0]), "a clip crosses episodes");
        let actions = actions[at * num_steps * frameskip * 2..][..num_steps * frameskip * 2].to_vec();
        (episodes[0], rows[at * num_steps..][..num_steps].to_vec(), actions)
    };
    (0..batch.rows()).map(clip).collect()
}

fn epoch(batches: &mut Batches) -> Vec<Batch> {
    batches.map(Result::unwrap).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_window_appears_exactly_once_per_epoch(
        lengths in proptest::collection::vec(1usize..30, 1..8),
        num_steps in 1usize..5,
        frameskip in 1usize..4,
        size in 1usize..9,
        threads in 1usize..4,
        shuffle in proptest::option::of(0u64..100),
    ) {
        let options = ClipOptions::default().num_steps(num_steps).frameskip(frameskip).threads(Some(threads));
        let span = num_steps * frameskip;
        let Ok(loader) = Loader::new(Box::new(dataset(&lengths)), &options) else {
            prop_assert!(lengths.iter().all(|&len| len < span));
            return Ok(());
        };
        let mut expected = BTreeMap::new();
        for (episode, &len) in lengths.iter().enumerate() {
            for start in 0..(len + 1).saturating_sub(span) {
                expected.insert((episode as i64, start as i64), 2);
            }
        }
        prop_assert_eq!(loader.len(), expected.len());
        let mut batches = loader.batches(&BatchOptions::default().size(size).shuffle(shuffle)).unwrap();
        for _ in 0..2 {
            let batches = epoch(&mut batches);
            for (number, batch) in batches.iter().enumerate() {
                prop_assert!(batch.rows() == size || number + 1 == batches.len());
                for (episode, rows, actions) in clips(batch, num_steps, frameskip) {
                    let steps: Vec<i64> = (0..num_steps).map(|step| rows[0] + (step * frameskip) as i64).collect();
                    prop_assert_eq!(&rows, &steps);
                    for (at, pair) in actions.chunks(2).enumerate() {
                        let row = rows[0] as f32 + at as f32;
                        prop_assert_eq!(pair, &[row, -row]);
                    }
                    *expected.get_mut(&(episode, rows[0])).unwrap() -= 1;
                }
            }
        }
        prop_assert!(expected.values().all(|&left| left == 0));
    }

    #[test]
    fn a_resumed_stream_gives_the_rest_of_the_sequence(
        lengths in proptest::collection::vec(4usize..20, 1..5),
        size in 1usize..7,
        stop in 0usize..40,
        threads in [1usize..4, 1usize..4],
        shuffle in proptest::option::of(0u64..100),
        drop_last: bool,
    ) {
        let load = |threads| {
            let options = ClipOptions::default().num_steps(2).threads(Some(threads)).goals(Some(GoalOptions::default().keys(Some(vec!["row".into(), "ep".into()]))));
            Loader::new(Box::new(dataset(&lengths)), &options).unwrap()
        };
        let options = BatchOptions::default().size(size).shuffle(shuffle).drop_last(drop_last).epochs(Some(3)).ahead(1);
        // What `next_batch` returns, ends of epochs included.
        let rest = |mut batches: Batches, skip: usize| {
            let mut batch = batches.new_batch();
            let mut all = Vec::new();
            let mut position = batches.position();
            for number in 0.. {
                if number == skip {
                    position = batches.position();
                }
                let more = batches.next_batch(&mut batch).unwrap();
                if !more && batches.position().epoch >= 3 {
                    break;
                }
                all.push(more.then(|| batch.clone()));
            }
            (all, position)
        };
        let Ok(first) = load(threads[0]).batches(&options) else {
            prop_assert!(drop_last);
            return Ok(());
        };
        let (whole, position) = rest(first, stop);
        let text = serde_json::to_string(&position).unwrap();
        let position: Position = serde_json::from_str(&text).unwrap();
        let second = load(threads[1]).batches_from(&options, &position).unwrap();
        let (resumed, _) = rest(second, 0);
        let skipped = if stop <= whole.len() { stop } else { 0 };
        prop_assert_eq!(&whole[skipped..], &resumed);
    }

    #[test]
    fn goals_lie_in_the_dataset_and_depend_on_the_epoch_alone(
        lengths in proptest::collection::vec(1usize..30, 1..6),
        frameskip in 1usize..4,
        offset in 1usize..4,
    ) {
        let goals = GoalOptions::default().offset(Some(offset)).keys(Some(vec!["row".into()]));
        let options = ClipOptions::default().num_steps(2).frameskip(frameskip).goals(Some(goals));
        let Ok(loader) = Loader::new(Box::new(dataset(&lengths)), &options) else { return Ok(()) };
        let mut batches = loader.batches(&BatchOptions::default().size(7)).unwrap();
        for number in 0..2 {
            let rows: Vec<i64> =
                epoch(&mut batches).iter().flat_map(|batch| batch.get::<i64>("goal_row").unwrap().to_vec()).collect();
            for (clip, row) in rows.into_iter().enumerate() {
                let (episode, goal) = loader.goal(clip, number).unwrap();
                prop_assert!(goal < lengths[episode]);
                prop_assert_eq!(row, goal as i64);
                let start = loader.clip(clip).unwrap();
                prop_assert!(start.start + offset * frameskip < lengths[start.episode], "no later row");
            }
        }
    }

    #[test]
    fn parts_of_a_split_are_disjoint_and_complete(
        count in 0usize..60,
        fractions in proptest::collection::vec(0.0f64..1.0, 1..5),
        seed: u64,
    ) {
        let Ok(parts) = split_episodes(count, &fractions, seed) else {
            prop_assert!(fractions.iter().sum::<f64>() == 0.0);
            return Ok(());
        };
        prop_assert_eq!(parts.len(), fractions.len());
        let mut all = parts.concat();
        all.sort_unstable();
        prop_assert_eq!(all, (0..count).collect::<Vec<_>>());
        prop_assert_eq!(parts, split_episodes(count, &fractions, seed).unwrap());
    }
}

#[test]
fn orders_differ_by_seed_and_epoch() {
    let loader = Loader::new(Box::new(dataset(&[40, 40])), &ClipOptions::default()).unwrap();
    let order = |seed, epochs| {
        let options = BatchOptions::default().size(80).shuffle(seed);
        let mut batches = loader.batches(&options).unwrap();
        let all: Vec<Batch> = (0..epochs).flat_map(|_| epoch(&mut batches)).collect();
        all.last().unwrap().clone()
    };
    assert_eq!(order(Some(1), 1), order(Some(1), 1));
    assert_ne!(order(Some(1), 1), order(Some(1), 2));
    assert_ne!(order(Some(1), 1), order(Some(2), 1));
    assert_eq!(order(None, 1), order(None, 2));
}

#[test]
fn positions_of_other_loaders_are_refused() {
    let loader = Loader::new(Box::new(dataset(&[10])), &ClipOptions::default()).unwrap();
    let other =
        Loader::new(Box::new(dataset(&[10])), &ClipOptions::default().num_steps(2).clips(Clips::Every));
    let options = BatchOptions::default().shuffle(Some(1));
    let position = loader.batches(&options).unwrap().position();
    let message = other.unwrap().batches_from(&options, &position).err().unwrap().to_string();
    assert!(message.contains("10 clips") && message.contains("9 clips"), "{message}");
    assert!(loader.batches_from(&options.shuffle(None), &position).is_err());
    assert!(loader.batches(&options.size(0)).is_err());
    assert!(loader.batches(&options.size(11).drop_last(true)).is_err());
}
