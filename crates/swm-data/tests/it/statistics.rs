//! Statistics in one pass are those of the plain formulas, and stay with the dataset.

use std::fs;
use std::sync::Arc;

use proptest::prelude::*;
use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::stats::{Statistics, StatisticsOptions, side_file};
use swm_data::{MemoryDataset, WriteMode, open};

use crate::support::record;

/// Episodes whose column `x` holds these rows.
fn dataset(episodes: &[Vec<[f64; 2]>]) -> MemoryDataset {
    let schema = Schema::new(vec![Field::step("x", Dtype::F64, &[2])]).unwrap();
    let batch = |rows: &Vec<[f64; 2]>| {
        let mut batch = Batch::new(schema.clone(), rows.len());
        if let SliceMut::F64(values) = batch.column_mut(0) {
            values.copy_from_slice(rows.as_flattened());
        }
        Arc::new(batch)
    };
    let batches: Vec<_> = episodes.iter().map(batch).collect();
    MemoryDataset::new("made up", schema.clone(), None, batches).unwrap()
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * (1.0 + a.abs().max(b.abs()))
}

/// Numbers of different sizes; now and then one is missing.
fn row() -> impl Strategy<Value = [f64; 2]> {
    (prop_oneof![9 => -1e3f64..1e3, 1 => Just(f64::NAN)], -5f64..5.0).prop_map(|(a, b)| [a, b])
}

proptest! {
    #[test]
    fn one_pass_equals_the_plain_formulas(
        episodes in proptest::collection::vec(proptest::collection::vec(row(), 0..40), 1..6),
        level in 0.0f64..=1.0,
    ) {
        let options = StatisticsOptions { quantiles: vec![level], ..StatisticsOptions::default() };
        let statistics = Statistics::compute(&mut dataset(&episodes), &options).unwrap();
        let all: Vec<[f64; 2]> = episodes.concat();
        let rows: Vec<[f64; 2]> = all.iter().copied().filter(|row| row[0].is_finite()).collect();
        let found = &statistics.columns["x"];
        prop_assert_eq!(statistics.rows, all.len() as u64);
        prop_assert_eq!((found.rows, found.not_finite), (rows.len() as u64, (all.len() - rows.len()) as u64));
        if rows.is_empty() {
            prop_assert!(found.mean.is_empty());
            return Ok(());
        }
        for at in 0..2 {
            let mut values: Vec<f64> = rows.iter().map(|row| row[at]).collect();
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
            values.sort_by(f64::total_cmp);
            let place = level * (n - 1.0);
            let (low, high) = (values[place.floor() as usize], values[place.ceil() as usize]);
            prop_assert!(close(found.mean[at], mean), "mean {} {}", found.mean[at], mean);
            prop_assert!(close(found.std[at], std), "std {} {}", found.std[at], std);
            prop_assert_eq!((found.min[at], found.max[at]), (values[0], values[values.len() - 1]));
            prop_assert!(close(found.quantiles[0].1[at], low + (high - low) * place.fract()));
        }
        prop_assert!(found.quantiles_exact);
    }
}

#[test]
fn constants_are_only_shifted_and_come_back() {
    // A constant as f32 has it, one with the noise of its rounding, and a value of a small unit around 0.
    let noise = f64::from(0.1f32) * f64::from(f32::EPSILON);
    for (constant, noise) in
        [(f64::from(0.1f32), 0.0), (f64::from(0.1f32), noise), (1234.567, 1e-4), (0.0, 5e-9)]
    {
        let rows: Vec<[f64; 2]> =
            (0..600).map(|i| [constant + noise * f64::from(i % 2), f64::from(i % 5)]).collect();
        let options = StatisticsOptions::default();
        let statistics = Statistics::compute(&mut dataset(&[rows]), &options).unwrap();
        let x = &statistics.columns["x"];
        let held_out = [constant as f32 + 1e-3, 7.0];
        let mut values = held_out;
        x.standardize(&mut values);
        assert!((values[0] - 1e-3).abs() < 2e-4, "{constant} {noise}: {values:?}");
        assert!((f64::from(values[1]) - (7.0 - x.mean[1]) / x.std[1]).abs() < 1e-6);
        x.restore(&mut values);
        assert!((values[0] - held_out[0]).abs() < 2e-4 && (values[1] - 7.0).abs() < 1e-5, "{values:?}");
    }
}

#[test]
fn a_million_rows_keep_their_mean_and_std() {
    let value = |i: u32| f64::from(0.4249f32 + if i.is_multiple_of(2) { 0.001 } else { -0.001 });
    let rows: Vec<[f64; 2]> = (0..1_000_000).map(|i| [value(i), 1e6 + f64::from(i % 2)]).collect();
    let options = StatisticsOptions { quantiles: Vec::new(), ..StatisticsOptions::default() };
    let statistics = Statistics::compute(&mut dataset(&[rows]), &options).unwrap();
    let x = &statistics.columns["x"];
    assert!((x.mean[0] - 0.4249).abs() < 1e-7 && (x.std[0] - 0.001).abs() < 1e-7, "{x:?}");
    assert!((x.mean[1] - 1_000_000.5).abs() < 1e-8 && (x.std[1] - 0.5).abs() < 1e-8, "{x:?}");
}

#[test]
fn quantiles_of_a_sample_are_near_and_the_same_every_time() {
    let rows: Vec<[f64; 2]> = (0..50_000).map(|i| [f64::from(i), f64::from(i % 7)]).collect();
    let options = StatisticsOptions { sample: 2000, ..StatisticsOptions::default() };
    let compute = || Statistics::compute(&mut dataset(std::slice::from_ref(&rows)), &options).unwrap();
    let statistics = compute();
    assert_eq!(statistics, compute());
    let x = &statistics.columns["x"];
    assert!(!x.quantiles_exact && close(x.mean[0], 24_999.5));
    for (level, values) in &x.quantiles {
        // Three standard errors of 2000 draws.
        let error = 3.0 * (level * (1.0 - level) / 2000.0).sqrt();
        assert!((values[0] / 50_000.0 - level).abs() < error, "{level}: {values:?}");
    }
}

#[test]
fn images_have_statistics_by_channel() {
    let schema = Schema::new(vec![Field::step("pixels", Dtype::U8, &[3, 5, 3])]).unwrap();
    let mut batch = Batch::new(schema.clone(), 4);
    let mut levels = vec![Vec::new(); 3];
    if let SliceMut::U8(values) = batch.column_mut(0) {
        for (at, value) in values.iter_mut().enumerate() {
            *value = (at * at % 251) as u8;
            levels[at % 3].push(f64::from(*value));
        }
    }
    let mut dataset = MemoryDataset::new("images", schema.clone(), None, [Arc::new(batch)]).unwrap();
    let options = StatisticsOptions { quantiles: vec![0.3], ..StatisticsOptions::default() };
    let statistics = Statistics::compute(&mut dataset, &options).unwrap();
    let pixels = &statistics.columns["pixels"];
    for (channel, values) in levels.iter_mut().enumerate() {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        assert!(close(pixels.mean[channel], mean) && close(pixels.std[channel], std));
        values.sort_by(f64::total_cmp);
        assert_eq!((pixels.min[channel], pixels.max[channel]), (values[0], values[59]));
        let expected = values[17] + (values[18] - values[17]) * 0.7;
        assert!(close(pixels.quantiles[0].1[channel], expected));
    }
}

#[test]
fn statistics_are_found_where_nothing_can_be_kept() {
    let folder = tempfile::tempdir().unwrap();
    // Before it is named, the file has a name that is longer than names may be: a test may run as a user who may write everywhere.
    let path = folder.path().join(format!("{}.h5", "d".repeat(238)));
    record(&path, WriteMode::Append, 0..1).unwrap();
    let mut dataset = open(&path).unwrap();
    let options = StatisticsOptions::default();
    let found = Statistics::load_or_compute(dataset.as_mut(), &options).unwrap();
    assert_eq!(found, Statistics::compute(dataset.as_mut(), &options).unwrap());
    assert_eq!(Statistics::load(dataset.as_ref()).unwrap(), None);
}

#[test]
fn statistics_stay_with_the_dataset_until_it_grows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..3).unwrap();
    let mut dataset = open(&path).unwrap();
    assert_eq!(Statistics::load(dataset.as_ref()).unwrap(), None);
    let keys = Some(["action", "state", "pixels", "goal"].map(str::to_owned).to_vec());
    let options = StatisticsOptions { keys, ..StatisticsOptions::default() };
    let computed = Statistics::load_or_compute(dataset.as_mut(), &options).unwrap();
    // A NaN stands in the second action of the first two rows of every episode but the short one.
    assert_eq!(computed.columns["action"].not_finite, 2);
    assert_eq!(computed.columns["goal"].rows, 3 * 1600);
    assert!(path.with_file_name("data.h5.stats.json").exists());
    assert_eq!(Statistics::load(dataset.as_ref()).unwrap(), Some(computed.clone()));
    assert_eq!(Statistics::load_or_compute(dataset.as_mut(), &options).unwrap(), computed);

    let mut values = [1.5f32, -2.0, 3.0, 4.0];
    let action = &computed.columns["action"];
    action.standardize(&mut values);
    let expected = (1.5 - action.mean[0]) / action.std[0];
    assert!((f64::from(values[0]) - expected).abs() < 1e-6);
    action.restore(&mut values);
    assert!(values.iter().zip([1.5, -2.0, 3.0, 4.0]).all(|(a, b)| (a - b).abs() < 2e-3));

    record(&path, WriteMode::Append, 3..4).unwrap();
    let longer = open(&path).unwrap();
    assert_eq!(Statistics::load(longer.as_ref()).unwrap(), None);
    assert!(computed.store(longer.as_ref()).unwrap_err().to_string().contains("another dataset"));
    fs::write(side_file(&path), b"{").unwrap();
    assert!(Statistics::load(longer.as_ref()).unwrap_err().to_string().contains("remove it"));

    let text = Some(vec!["task".to_owned()]);
    let refused = Statistics::compute(dataset.as_mut(), &StatisticsOptions { keys: text, ..options });
    assert!(refused.unwrap_err().to_string().contains("`task` holds text"));
}
