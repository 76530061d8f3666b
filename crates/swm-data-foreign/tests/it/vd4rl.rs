//! HDF5 files of V-D4RL.

use std::fs;

use swm_data::OpenOptions;

use crate::open;
use crate::published::{check, column_of, golden, lengths, numbers, opened, rows};

const SAMPLE: &str = "vd4rl_toy";

#[test]
fn the_action_of_a_row_is_the_one_that_led_to_the_next() {
    let names = [
        ("action", "action", 1.0),
        ("reward", "reward", 1.0),
        ("discount", "discount", 1.0),
        ("step_type", "step_type", 1.0),
    ];
    let mut dataset = check(SAMPLE, &OpenOptions::default(), &names);
    // The second episode is cut into 3 rows of the file `2.hdf5` and 2 of `10.hdf5`.
    assert_eq!(lengths(dataset.as_ref()), [5, 3, 2, 5]);
    for (episode, (length, is_terminated, is_truncated)) in
        [(5, false, true), (3, false, false), (2, false, true), (5, true, false)].into_iter().enumerate()
    {
        let mut of = |name: &str| {
            let column = column_of(dataset.as_ref(), name);
            numbers(&rows(dataset.as_mut(), column, episode, 0, length))
        };
        for (name, dim) in [("action", 2), ("reward", 1)] {
            let missing = of(name).iter().position(|value| value.is_nan());
            assert_eq!(missing, Some((length - 1) * dim), "{name} {episode}");
        }
        for (name, is_marked) in [("terminated", is_terminated), ("truncated", is_truncated)] {
            let marks = of(name);
            let (last, before) = marks.split_last().unwrap();
            assert!(
                (*last != 0.0) == is_marked && before.iter().all(|&mark| mark == 0.0),
                "{name} {marks:?}"
            );
        }
    }
    let info = dataset.info();
    assert_eq!((info.format, info.skipped.len()), ("vd4rl", 0));
    assert!(info.notes.iter().any(|note| note.contains("led to an image")), "{:?}", info.notes);
}

#[test]
fn a_file_is_a_dataset_of_its_own() {
    let mut file = open(&golden(SAMPLE).join("10.hdf5")).unwrap();
    let mut folder = open(&golden(SAMPLE)).unwrap();
    assert_eq!(lengths(file.as_ref()), [2, 5]);
    let pixels = column_of(file.as_ref(), "pixels");
    assert_eq!(file.schema().fields()[pixels].shape, [8, 8, 3]);
    let of_folder = column_of(folder.as_ref(), "pixels");
    assert_eq!(rows(file.as_mut(), pixels, 1, 0, 5), rows(folder.as_mut(), of_folder, 3, 0, 5));
}

#[test]
fn a_file_of_another_layout_among_them_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixed");
    fs::create_dir(&path).unwrap();
    fs::copy(golden(SAMPLE).join("2.hdf5"), path.join("0.hdf5")).unwrap();
    fs::copy(golden("halfcheetah-medium-v2.hdf5"), path.join("1.hdf5")).unwrap();
    let refused = opened(&path, &OpenOptions::default()).err().unwrap().to_string();
    assert!(refused.contains("1.hdf5") && refused.contains("`step_type`"), "{refused}");
}
