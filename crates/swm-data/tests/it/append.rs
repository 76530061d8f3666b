//! Write modes, and continuing a file.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::{Batch, Dtype, Field, FieldKind, Metadata, Schema};
use swm_data::{Format, WriteMode, WriteOptions};

use crate::support::{
    assert_same, contents, episode, fail_before_the_first_episode, metadata, record, schema,
};
use crate::{FORMATS, create, create_with, open, registry};

#[test]
fn appending_equals_recording_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let [parts, whole] = ["parts.h5", "whole.h5"].map(|name| folder.path().join(name));
    record(&whole, WriteMode::Append, 0..7).unwrap();
    assert_eq!(record(&parts, WriteMode::Append, 0..3).unwrap(), 0);
    assert_eq!(record(&parts, WriteMode::Append, 3..4).unwrap(), 3);
    assert_eq!(record(&parts, WriteMode::Append, 4..7).unwrap(), 4);
    let (parts, whole) = (contents(&parts), contents(&whole));
    assert_eq!(parts.len(), 7);
    for (a, b) in parts.iter().zip(&whole) {
        assert_same(a, b);
    }
}

#[test]
fn in_every_format_a_writer_knows_the_columns_that_it_continues() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        assert!(
            !create(&path, WriteMode::Append, None).unwrap().holds("action"),
            "{}: nothing is there",
            format.name
        );
        record(&path, WriteMode::Append, 0..1).unwrap();
        let writer = create(&path, WriteMode::Append, None).unwrap();
        let there = open(&path).unwrap();
        for field in there.schema().fields() {
            assert!(writer.holds(&field.name), "{}: {}", format.name, field.name);
        }
        assert!(!writer.holds("variation.of.nothing"), "{}", format.name);
        drop(writer);
        assert!(
            !create(&path, WriteMode::Overwrite, None).unwrap().holds("action"),
            "{}: all is replaced",
            format.name
        );
    }
}

#[test]
fn the_mode_decides_about_an_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let message = record(&path, WriteMode::Error, 0..1).unwrap_err().to_string();
    assert!(message.contains("exists already") && message.contains("overwrite"), "{message}");
    assert_eq!(record(&path, WriteMode::Overwrite, 2..3).unwrap(), 0);
    let read = contents(&path);
    assert_eq!(read.len(), 1);
    assert_same(&episode(&schema(), 2, 300), &read[0]);
    for mode in WriteMode::ALL {
        assert_eq!(mode.name().parse::<WriteMode>().unwrap(), mode);
    }
    assert!("replace".parse::<WriteMode>().unwrap_err().contains("overwrite"));
}

#[test]
fn an_overwritten_file_stays_until_recording_begins() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let bytes = fs::read(&path).unwrap();
    drop(create(&path, WriteMode::Overwrite, None).unwrap());
    assert!(fs::read(&path).unwrap() == bytes);
}

/// Everything below a path, by name.
fn tree(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    if path.is_file() {
        return vec![(path.to_owned(), fs::read(path).unwrap())];
    }
    let mut entries: Vec<_> = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    entries.iter().flat_map(|entry| tree(entry)).collect()
}

#[test]
fn in_every_format_what_is_no_dataset_is_neither_continued_nor_replaced_nor_called_damaged() {
    for format in registry().all::<Format>() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        record(&path, WriteMode::Error, 0..1).unwrap();
        let is_folder = path.is_dir();
        let mut foreign: Vec<PathBuf> = ["letter", "several"].map(|name| folder.path().join(name)).to_vec();
        if is_folder {
            for (path, names) in
                foreign.iter().zip([&["notes.txt"][..], &["data.npz", "a.parquet", "meta.json"]])
            {
                fs::create_dir(path).unwrap();
                names.iter().for_each(|name| fs::write(path.join(name), "my notes").unwrap());
            }
        } else {
            fs::write(&foreign[0], "my notes").unwrap();
            fs::write(&foreign[1], [7; 5000]).unwrap();
        }
        for other in registry().all::<Format>().filter(|other| other.name != format.name) {
            let there = folder.path().join(format!("other.{}", other.extensions[0]));
            record(&there, WriteMode::Error, 0..1).unwrap();
            if there.is_dir() == is_folder {
                foreign.push(there);
            }
        }
        let others = foreign.len() - 2;
        for (at, there) in foreign.iter().enumerate() {
            let before = tree(folder.path());
            for (mode, what) in [(WriteMode::Append, "to continue"), (WriteMode::Overwrite, "to replace")] {
                let context = format!("{}, {}, {what}", format.name, there.display());
                let options = WriteOptions::default().mode(mode);
                let refused = create_with(there, &options, Some(format.name)).map(drop);
                let message = match refused {
                    Ok(()) => panic!("{context}: it is taken"),
                    Err(error) => error.to_string(),
                };
                assert!(message.contains(&*there.to_string_lossy()), "{context}: {message}");
                assert!(
                    !message.contains("damaged") && !message.contains("os error"),
                    "{context}: {message}"
                );
                if at < 2 {
                    let part = format!("no dataset in the format `{}` {what}", format.name);
                    assert!(message.contains(&part), "{context}: {message}");
                }
            }
            assert!(tree(folder.path()) == before, "{}: {}", format.name, there.display());
        }
        assert_eq!(
            others,
            if is_folder { registry().all::<Format>().count() - 3 } else { 1 },
            "{}",
            format.name
        );
        if !is_folder {
            // An empty file, as `mktemp` makes, holds nothing that could be lost.
            fs::write(&path, "").unwrap();
            assert_eq!(record(&path, WriteMode::Overwrite, 0..1).unwrap(), 0, "{}", format.name);
            assert_eq!(contents(&path).len(), 1);
        }
    }
}

#[test]
fn a_second_writer_is_refused_while_the_first_lives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let mut first = create(&path, WriteMode::Append, None).unwrap();
    for mode in WriteMode::ALL {
        let message = create(&path, mode, None).err().unwrap().to_string();
        assert!(message.contains("data.h5") && message.contains(&this_process()), "{message}");
    }
    first.begin(&schema(), &metadata()).unwrap();
    assert!(create(&path, WriteMode::Append, None).is_err());
    drop(first);
    let writer = create(&path, WriteMode::Append, None).unwrap();
    assert_eq!(writer.num_episodes(), 0);
}

#[test]
fn in_every_format_the_second_writer_learns_who_the_first_is() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        // A lock that a killed process left is none.
        let lock = folder.path().join(format!("data.{}.lock", format.extensions[0]));
        fs::write(&lock, "process 4194305 on elsewhere\n").unwrap();
        let first = create(&path, WriteMode::Append, None).unwrap();
        let message = create(&path, WriteMode::Append, None).err().unwrap().to_string();
        assert!(message.contains(&this_process()), "{}: {message}", format.name);
        drop(first);
        assert!(!lock.exists());
        record(&path, WriteMode::Append, 0..1).unwrap();
    }
}

#[test]
fn in_every_format_nothing_is_left_of_a_recording_without_an_episode() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        fail_before_the_first_episode(registry(), &path);
    }
    // A folder that was there stays, with what is not the recording's.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    fs::create_dir(&path).unwrap();
    let fail = |mode| {
        create(&path, mode, Some("folder")).unwrap().begin(&schema(), &metadata()).unwrap();
        fs::read_dir(&path).unwrap().count()
    };
    assert_eq!(fail(WriteMode::Append), 0);
    record(&path, WriteMode::Append, 0..1).unwrap();
    fs::write(path.join("letter.txt"), "dear").unwrap();
    assert_eq!(fail(WriteMode::Overwrite), 1);
}

/// How a lock names this process; where locked files cannot be read, it does not.
fn this_process() -> String {
    match cfg!(unix) {
        true => format!("is being written by process {} on ", std::process::id()),
        false => "is being written by".to_owned(),
    }
}

#[test]
fn what_does_not_fit_is_refused_and_leaves_the_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..2).unwrap();
    let bytes = fs::read(&path).unwrap();

    let changed = |change: &dyn Fn(&mut Vec<Field>)| {
        let mut fields = schema().fields().to_vec();
        change(&mut fields);
        Schema::new(fields).unwrap()
    };
    let refused = |schema: &std::sync::Arc<Schema>, metadata: &Metadata| {
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(schema, metadata).unwrap_err().to_string()
    };
    for (schema, part) in [
        (changed(&|fields| drop(fields.remove(3))), "no column `reward`"),
        (changed(&|fields| fields.push(Field::step("speed", Dtype::F32, &[]))), "it has no column `speed`"),
        (changed(&|fields| fields[2].shape = vec![6]), "`state` holds float64 [7]"),
        (changed(&|fields| fields[1].dtype = Dtype::F64), "`action` holds float32"),
        (changed(&|fields| fields[3].kind = FieldKind::Episode), "per Step"),
    ] {
        let message = refused(&schema, &metadata());
        assert!(message.contains(part) && message.contains("data.h5"), "{message}");
    }
    let message = refused(&schema(), &Metadata { env: "swm/Other-v1".into(), ..metadata() });
    assert!(message.contains("swm/Test-v1") && message.contains("swm/Other-v1"), "{message}");
    let message = refused(&schema(), &Metadata { frame_skip: 5, ..metadata() });
    assert!(message.contains("frame skip"), "{message}");
    assert!(fs::read(&path).unwrap() == bytes, "a refused append changed the file");
}

#[test]
fn another_policy_may_continue_and_the_first_stays_on_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..2).unwrap();
    for policy in ["expert", "expert"] {
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        let other = Metadata { policy: policy.into(), seed: 8, ..metadata() };
        let there = writer.begin(&schema(), &other).unwrap();
        writer.write_episode(&episode(&schema(), there as usize, 4)).unwrap();
        writer.finish().unwrap();
    }
    let dataset = open(&path).unwrap();
    assert_eq!((dataset.num_episodes(), dataset.metadata().unwrap().policy.as_str()), (4, "random"));
    let attributes = hdf5_metno::File::open(&path).unwrap().attr_names().unwrap();
    assert!(
        attributes.contains(&"swm_metadata_2".to_owned())
            && !attributes.contains(&"swm_metadata_3".to_owned())
    );
}

#[test]
fn columns_that_cannot_be_stored_and_wrong_calls() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let begin = |fields: Vec<Field>| {
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(&Schema::new(fields).unwrap(), &metadata()).unwrap_err().to_string()
    };
    assert!(begin(vec![]).contains("no columns"));
    assert!(begin(vec![Field::step("ep_len", Dtype::I32, &[])]).contains("reserved"));
    assert!(begin(vec![Field::step("a/b", Dtype::I32, &[])]).contains("no `/`"));
    assert!(begin(vec![Field::step("pixels", Dtype::U8, &[0, 64, 3])]).contains("holds no values"));
    assert!(!path.exists());

    let mut writer = create(&path, WriteMode::Append, None).unwrap();
    let rows = episode(&schema(), 0, 5);
    assert!(writer.write_episode(&rows).unwrap_err().to_string().contains("no recording"));
    writer.begin(&schema(), &metadata()).unwrap();
    assert!(writer.begin(&schema(), &metadata()).unwrap_err().to_string().contains("begun already"));
    assert!(writer.write_episode(&Batch::new(schema(), 0)).unwrap_err().to_string().contains("without rows"));
    let other = Schema::new(vec![Field::step("x", Dtype::F64, &[])]).unwrap();
    assert!(writer.write_episode(&Batch::new(other, 1)).unwrap_err().to_string().contains("other columns"));
    writer.write_episode(&rows).unwrap();
    writer.finish().unwrap();
    writer.finish().unwrap();
    assert!(writer.write_episode(&rows).is_err());
    assert_eq!(contents(&path).len(), 1);
}

#[test]
fn a_folder_that_is_not_there_or_a_path_that_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none").join("data.h5");
    let message = create(&path, WriteMode::Append, None).err().unwrap().to_string();
    assert!(message.contains("cannot create") && message.contains("data.h5"), "{message}");
    let path = folder.path().join("folder.h5");
    fs::create_dir(&path).unwrap();
    let message = create(&path, WriteMode::Append, None).err().unwrap().to_string();
    assert!(message.contains("is a folder"), "{message}");
}

#[test]
fn text_that_does_not_fit_ends_the_recording_but_not_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let schema = Schema::new(vec![Field::step("task", Dtype::Str, &[])]).unwrap();
    for (text, part) in [("x".repeat(257), "257 bytes"), ("a\0b".to_owned(), "NUL")] {
        let mut writer = create(&path, WriteMode::Overwrite, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        let mut write = |text: &str| {
            let mut rows = Batch::new(schema.clone(), 1);
            rows.rows_mut().write(0, &[text.to_owned()]);
            writer.write_episode(&rows)
        };
        write(&"é".repeat(128)).unwrap();
        let message = write(&text).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("its 1 finished episodes are safe"), "{message}");
        assert!(write("more").is_err());
    }
}
