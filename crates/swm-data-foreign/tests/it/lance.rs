//! Lance tables, read without the crates of Lance.

use std::path::{Path, PathBuf};

use swm_core::{Column, Dtype, FieldKind};
use swm_data::loader::{ClipOptions, Loader};
use swm_data::tools::compare::compare;
use swm_data::tools::verify::verify;
use swm_data::{DataError, Dataset, OpenOptions, Steps};

use crate::published::{check, column_of, lengths, numbers, opened, rows};
use crate::{mutate, open};

fn table(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/lance").join(format!("{name}.lance"))
}

fn names(dataset: &dyn Dataset) -> Vec<&str> {
    dataset.schema().fields().iter().map(|field| field.name.as_str()).collect()
}

/// As stable-worldmodel's own writer made it, in files of version 2.2.
#[test]
fn tables_of_the_reference_open_with_those_beside_them() {
    let same = [("action", "action", 1.0), ("proprio", "proprio", 1.0), ("state", "state", 1.0)];
    let mut dataset = check("upstream_head.lance", &OpenOptions::default(), &same);
    assert_eq!(lengths(dataset.as_ref()), [5, 4]);
    assert_eq!(names(dataset.as_ref()), ["pixels", "action", "proprio", "state", "goal", "scene", "seed"]);
    let (pixels, action) = (column_of(dataset.as_ref(), "pixels"), column_of(dataset.as_ref(), "action"));
    assert_eq!(dataset.schema().fields()[pixels].shape, [32, 32, 3]);
    // The action of a last row is NaN in the table.
    assert!(numbers(&rows(dataset.as_mut(), action, 1, 3, 1)).iter().all(|value| value.is_nan()));
    for (name, expected) in [("goal", vec![1.0, 2.0, 3.0]), ("seed", vec![1.0])] {
        let column = column_of(dataset.as_ref(), name);
        assert_eq!(dataset.schema().fields()[column].kind, FieldKind::Episode, "{name}");
        assert_eq!(numbers(&rows(dataset.as_mut(), column, 1, 0, 1)), expected, "{name}");
    }
    let scene = column_of(dataset.as_ref(), "scene");
    assert_eq!(rows(dataset.as_mut(), scene, 0, 0, 1), Column::Str(vec!["<mujoco model='0'/>".to_owned()]));
    assert!(verify(dataset.as_mut(), &mut |_| {}).problems.is_empty());
    let loader = Loader::new(dataset, &ClipOptions::default().num_steps(2)).unwrap();
    assert_eq!(loader.len(), 4 + 3);
    let mut clip = loader.new_batch();
    loader.read(&[6], &mut clip).unwrap();
}

/// Columns, their sums, and how many of their values are missing.
const SUMS: [(&str, f64, usize); 4] = [
    ("state", 90_087.462_144_315_24, 0),
    ("action", 1.110_146_328_108_385_2, 8),
    ("reward", -28_827.555_084_228_516, 4),
    ("id", 2.897_701_028_920_327e20, 0),
];

/// A recording of PushT; the sums are those of pylance.
#[test]
fn a_recording_of_the_reference_has_the_values_that_pylance_reads() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets");
    let mut dataset = open(&golden.join("pusht_up_64_lance.lance")).unwrap();
    assert_eq!((lengths(dataset.as_ref()), dataset.info().skipped.len()), (vec![21; 4], 0));
    let field = |name: &str| dataset.schema().fields()[column_of(dataset.as_ref(), name)].clone();
    assert_eq!((field("pixels").shape, field("goal").shape), (vec![64, 64, 3], vec![64, 64, 3]));
    assert_eq!((field("reward").dtype, field("reward").shape), (Dtype::F32, vec![]));
    // The first row of an episode has no reward: rewards are in the rows that actions led to, as in our recordings.
    assert!(dataset.metadata().unwrap().source.as_ref().unwrap()["rewards"].is_null());
    for (name, sum, missing) in SUMS {
        let column = column_of(dataset.as_ref(), name);
        let all = (0..4).flat_map(|episode| numbers(&rows(dataset.as_mut(), column, episode, 0, 21)));
        let all: Vec<f64> = all.collect();
        assert_eq!(all.iter().filter(|value| value.is_nan()).count(), missing, "{name}");
        let found: f64 = all.iter().filter(|value| !value.is_nan()).sum();
        assert!((found - sum).abs() <= sum.abs() * 1e-12, "{name}: {found} {sum}");
    }
}

#[test]
fn episodes_follow_their_numbers_and_images_are_decoded() {
    let mut dataset = opened(&table("plain"), &OpenOptions::default()).unwrap();
    assert_eq!(lengths(dataset.as_ref()), [3, 2]);
    assert_eq!(
        names(dataset.as_ref()),
        ["pixels", "action", "a_b", "matrix", "words", "task", "count", "seed", "scene", "goal"]
    );
    let reasons: Vec<&str> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(reasons, ["mixed"]);
    // Red is the row of the table, green the column, blue the row of the image.
    let pixels = column_of(dataset.as_ref(), "pixels");
    assert_eq!(dataset.schema().fields()[pixels].shape, [8, 9, 3]);
    let Column::U8(bytes) = rows(dataset.as_mut(), pixels, 1, 1, 1) else { panic!() };
    assert_eq!((&bytes[..6], &bytes[bytes.len() - 3..]), (&[4, 0, 0, 4, 1, 0][..], &[4, 8, 7][..]));
    // Missing numbers, and a missing row, are NaN.
    let action = column_of(dataset.as_ref(), "action");
    let values = numbers(&rows(dataset.as_mut(), action, 0, 0, 3));
    assert_eq!((&values[..3], &values[4..]), (&[0.0, 0.0, 0.5][..], &[1.0, -2.0][..]));
    assert!(values[3].is_nan());
    assert!(numbers(&rows(dataset.as_mut(), action, 1, 1, 1)).iter().all(|value| value.is_nan()));
    // Rows of the table of episodes are in another order.
    for (name, expected) in [("seed", [40.0, 70.0]), ("goal", [4.0, 7.0])] {
        let column = column_of(dataset.as_ref(), name);
        for (episode, expected) in expected.into_iter().enumerate() {
            assert_eq!(numbers(&rows(dataset.as_mut(), column, episode, 0, 1))[0], expected, "{name}");
        }
    }
    let scene = column_of(dataset.as_ref(), "scene");
    assert_eq!(rows(dataset.as_mut(), scene, 0, 0, 1), Column::Str(vec![String::new()]));
    // Every second row.
    let field = dataset.schema().fields()[column_of(dataset.as_ref(), "count")].clone();
    assert_eq!((field.dtype, field.shape), (Dtype::I64, vec![]));
    let mut out = Column::zeros(Dtype::I64, 2);
    let count = column_of(dataset.as_ref(), "count");
    dataset.rows(count, 0, Steps { first: 0, count: 2, stride: 2 }, out.as_slice_mut()).unwrap();
    assert_eq!(out, Column::I64(vec![1_000_000_000_000, 1_000_000_000_002]));
}

#[test]
fn tables_of_this_package_have_the_columns_of_their_record() {
    let mut dataset = opened(&table("recorded"), &OpenOptions::default()).unwrap();
    assert_eq!(names(dataset.as_ref()), ["pixels", "action", "a.b", "matrix", "words", "task", "count"]);
    let field = |name: &str| dataset.schema().fields()[column_of(dataset.as_ref(), name)].clone();
    assert_eq!((field("a.b").dtype, field("a.b").shape), (Dtype::Bool, vec![]));
    assert_eq!((field("matrix").shape, field("task").kind), (vec![2, 3], FieldKind::Episode));
    let mut read = |name: &str, episode, count| {
        let column = column_of(dataset.as_ref(), name);
        rows(dataset.as_mut(), column, episode, 0, count)
    };
    assert_eq!(read("a.b", 0, 3), Column::Bool(vec![false, true, false]));
    assert_eq!(read("words", 1, 1), Column::Str(vec!["w3".to_owned(), "x".to_owned()]));
    assert_eq!(read("task", 1, 1), Column::Str(vec!["task 1".to_owned()]));
    assert_eq!(numbers(&read("matrix", 0, 2))[6..], [1.5, 1.75, 2.0, 2.25, 2.5, 2.75]);
}

#[test]
fn what_is_not_read_is_named_and_no_damage() {
    let error = open(&table("narrow_2_1")).err().unwrap();
    assert!(matches!(error, DataError::NotADataset { .. }), "{error:?}");
    assert!(error.to_string().contains("without `episode_idx`"), "{error}");
}

/// Rows of `deleted` are known by `count`; where nothing counts the rows of an episode, the deleted ones divide it.
#[test]
fn what_is_before_and_behind_deleted_rows_is_apart() {
    let mut dataset = opened(&table("deleted"), &OpenOptions::default()).unwrap();
    let firsts = [2, 12, 17, 21, 24, 36, 144];
    assert_eq!(lengths(dataset.as_ref()), [10, 3, 2, 3, 12, 10, 6]);
    assert_eq!(names(dataset.as_ref()), ["count"]);
    for (episode, (first, length)) in firsts.into_iter().zip(lengths(dataset.as_ref())).enumerate() {
        let expected: Vec<f64> = (first..first + length).map(|row| (1000 + row) as f64).collect();
        assert_eq!(numbers(&rows(dataset.as_mut(), 0, episode, 0, length)), expected);
    }
    let notes = dataset.info().notes.join("; ");
    assert!(notes.contains("104 of its rows are deleted"), "{notes}");
    assert!(notes.contains("amid its 5 episodes") && notes.contains("they are 7"), "{notes}");
    assert!(verify(dataset.as_mut(), &mut |_| {}).problems.is_empty());
    // No clip is over a gap.
    let loader = Loader::new(dataset, &ClipOptions::default().num_steps(3)).unwrap();
    assert_eq!(loader.len(), 8 + 1 + 1 + 10 + 8 + 4);
}

/// `deleted_many` has a bitmap; rows of an episode are counted by `frame_index`, which jumps.
#[test]
fn jumps_of_the_number_of_a_row_divide_episodes() {
    let mut dataset = opened(&table("deleted_many"), &OpenOptions::default()).unwrap();
    let mut expected = vec![60; 26];
    expected[3..5].copy_from_slice(&[10, 40]);
    (expected[6], expected[8]) = (55, 55);
    assert_eq!(lengths(dataset.as_ref()), expected);
    assert_eq!(names(dataset.as_ref()), ["frame_index"]);
    for (episode, first) in [(2, 0.0), (4, 20.0), (6, 5.0), (8, 0.0), (25, 0.0)] {
        let expected: Vec<f64> = (0..40).map(|step| first + f64::from(step)).collect();
        assert_eq!(numbers(&rows(dataset.as_mut(), 0, episode, 0, 40)), expected, "{episode}");
    }
    assert!(dataset.info().notes.join("; ").contains("5120 of its rows are deleted"));
}

#[test]
fn foreign_bytes_in_tables_are_errors_or_values() {
    for name in ["plain", "recorded", "deleted"] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.lance");
        crate::copied(&table(name), &path);
        mutate(name, &path);
    }
}

#[test]
fn two_handles_read_the_same() {
    let mut first = open(&table("plain")).unwrap();
    let mut second = first.share();
    let found = compare(first.as_mut(), second.as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap();
    assert!(found.equal, "{found:?}");
}

/// The rows of its `frames.lance`; its videos are blobs.
#[test]
fn a_dataset_of_lerobot_in_the_storage_of_lance_opens_without_its_videos() {
    let names_of = [("action", "action", 1.0), ("observation.state", "proprio", 1.0)];
    let dataset = check("lerobot_native_lance", &OpenOptions::default(), &names_of);
    assert_eq!((lengths(dataset.as_ref()), dataset.info().rows_per_second), (vec![5, 4], Some(10.0)));
    let skipped: Vec<&str> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(skipped, ["observation.images.top"]);
    let reason = &dataset.info().skipped[0].1;
    assert!(
        reason.contains("blobs of `videos.lance`") && reason.contains("open the dataset that was"),
        "{reason}"
    );
}
