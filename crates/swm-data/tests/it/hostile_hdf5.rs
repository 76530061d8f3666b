//! HDF5 files that name other files or other datasets: nothing of them is read, and the rest of the file is. All of them are harmless to
//! every program: they name files of the test, and what HDF5 allows. The guard goes by the kind of a link or storage, not by its target.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use hdf5_metno::File;
use hdf5_metno::types::VarLenUnicode;
use swm_data::{DataError, WriteMode, open};

use crate::support::{contents, record};

/// A file of one sound column, with what `more` adds.
fn file(path: &Path, more: impl FnOnce(&File)) {
    let file = File::create(path).unwrap();
    file.new_dataset_builder().with_data(&[1.0, 2.0, 3.0, 4.0]).create("state").unwrap();
    file.new_dataset_builder().with_data(&[4i32]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64]).create("ep_offset").unwrap();
    more(&file);
}

/// The names of the columns, and of what was left out, after the sound column was read.
fn names(path: &Path) -> (Vec<String>, Vec<(String, String)>) {
    let start = Instant::now();
    let dataset = open(path).unwrap();
    assert_eq!(contents(path)[0].get::<f64>("state").unwrap(), [1.0, 2.0, 3.0, 4.0]);
    assert!(start.elapsed() < Duration::from_secs(20));
    let columns = dataset.schema().fields().iter().map(|field| field.name.clone()).collect();
    (columns, dataset.info().skipped.to_vec())
}

/// Only the sound column is there, and `name` was left out for this reason.
fn assert_left_out(path: &Path, name: &str, reason: &str) {
    let (columns, skipped) = names(path);
    assert_eq!(columns, ["state"], "{name}");
    assert!(skipped.len() == 1 && skipped[0].0 == name && skipped[0].1.contains(reason), "{skipped:?}");
}

#[test]
fn raw_values_in_other_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, values) = (folder.path().join("data.h5"), folder.path().join("values.bin"));
    fs::write(&values, [7; 32]).unwrap();
    for target in [values.to_str().unwrap(), "values.bin"] {
        file(&path, |file| {
            file.new_dataset::<u8>().shape((4, 8)).external(target, 0, 32).create("more").unwrap();
        });
        assert_left_out(&path, "more", "lie in other files");
    }
    // The index of episodes may not come from there either.
    file(&path, |file| {
        file.unlink("ep_len").unwrap();
        file.new_dataset::<i32>().shape((1,)).external("values.bin", 0, 4).create("ep_len").unwrap();
    });
    let message = open(&path).err().unwrap().to_string();
    assert!(message.contains("no `ep_len`") && message.contains("lie in other files"), "{message}");
}

#[test]
fn links_by_name_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let [path, other] = ["data.h5", "other.h5"].map(|name| folder.path().join(name));
    file(&other, |_| ());
    for target in [&other, &folder.path().join("none.h5")] {
        file(&path, |file| file.link_external(target.to_str().unwrap(), "state", "more").unwrap());
        assert_left_out(&path, "more", "not followed");
    }
    for target in ["/state", "/nowhere"] {
        file(&path, |file| file.link_soft(target, "more").unwrap());
        assert_left_out(&path, "more", "not followed");
    }
    // A second name of the same values is a column.
    file(&path, |file| file.link_hard("state", "twin").unwrap());
    assert_eq!(names(&path).0, ["state", "twin"]);
}

#[test]
fn named_types_and_groups_do_not_make_a_file_unreadable() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    file(&path, |file| {
        file.commit_datatype("kind", &hdf5_metno::Datatype::from_type::<f64>().unwrap()).unwrap();
        file.create_group("notes").unwrap();
        file.link_soft("/nowhere", "dangling").unwrap();
    });
    assert_left_out(&path, "dangling", "not followed");
}

#[test]
fn virtual_datasets_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let other = folder.path().join("other.h5");
    file(&other, |_| ());
    // One that maps to itself is left out for the same reason.
    for source in [".", other.to_str().unwrap()] {
        file(&path, |file| {
            let mapped = file.new_dataset::<f64>().shape(4);
            mapped.virtual_map(source, "state", 4, .., 4, ..).create("mapped").unwrap();
        });
        assert_left_out(&path, "mapped", "virtual dataset");
    }
}

#[test]
fn unknown_filters_are_not_looked_for() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/hostile");
    assert_left_out(&golden.join("unknown_filter.h5"), "odd", "filter 40000 is unknown");
    let message = open(&golden.join("long_filter.h5")).err().unwrap().to_string();
    assert!(message.contains("`odd`") && message.contains("32 parameters"), "{message}");
}

#[test]
fn appending_writes_no_other_file() {
    let folder = tempfile::tempdir().unwrap();
    let [path, other] = ["data.h5", "other.h5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Error, 0..2).unwrap();
    record(&other, WriteMode::Error, 0..2).unwrap();
    let before = fs::read(&other).unwrap();
    let file = File::open_rw(&path).unwrap();
    file.unlink("ep_idx").unwrap();
    file.link_external(other.to_str().unwrap(), "ep_idx", "ep_idx").unwrap();
    drop(file);
    let error = record(&path, WriteMode::Append, 2..3).unwrap_err();
    assert!(matches!(error.downcast_ref(), Some(DataError::Mismatch { .. })), "{error}");
    assert!(fs::read(&other).unwrap() == before);
}

/// Where the collections of the heap are, which have the texts of any length.
fn collections(bytes: &[u8]) -> Vec<usize> {
    let found: Vec<usize> =
        bytes.windows(4).enumerate().filter(|(_, word)| word == b"GCOL").map(|(at, _)| at).collect();
    assert!(!found.is_empty(), "there is no text of any length");
    found
}

/// Every program refuses these: each bound of the way to a text is checked before it is followed.
#[test]
fn attributes_in_a_damaged_heap_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let sound = fs::read(&path).unwrap();
    // Of a collection: its signature, and its first object's number and length.
    let changes: [(usize, &[u8], &str); 3] = [
        (0, b"GCOX", "it is none"),
        (16, &[0x77, 0x07], "has no object"),
        (24, &[1, 0], "lies behind its end"),
    ];
    for (offset, change, reason) in changes {
        let mut bytes = sound.clone();
        for at in collections(&sound) {
            bytes[at + offset..][..change.len()].copy_from_slice(change);
        }
        fs::write(&path, &bytes).unwrap();
        let message = open(&path).err().unwrap().to_string();
        let parts = ["attribute `swm_", "the heap at byte ", reason];
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
    fs::write(&path, &sound).unwrap();
    assert_eq!(contents(&path).len(), 2);
}

#[test]
fn attributes_of_any_length_are_one_value() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let text: VarLenUnicode = "{".parse().unwrap();
    let file = File::create(&path).unwrap();
    file.new_attr::<VarLenUnicode>().create("swm_columns").unwrap().write_scalar(&text).unwrap();
    drop(file);
    let message = open(&path).err().unwrap().to_string();
    assert!(message.contains("attribute `swm_columns`: invalid type"), "{message}");
    for values in [vec![], vec![text.clone(), text]] {
        let file = File::create(&path).unwrap();
        file.new_attr::<VarLenUnicode>()
            .shape(values.len())
            .create("swm_columns")
            .unwrap()
            .write(&values)
            .unwrap();
        drop(file);
        let message = open(&path).err().unwrap().to_string();
        assert!(message.contains(&format!("has {} values, not one", values.len())), "{message}");
    }
}
