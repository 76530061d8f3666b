//! Datasets that are folders: of images (`folder`) and of videos (`video`), ours and the reference's.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::{Column, Field, FieldKind, Metadata};
use swm_data::format::{built_in, by_name};
use swm_data::{DataError, Steps, WriteMode, WriteOptions, create, create_with, open};

use crate::copied;
use crate::support::{assert_alike, bits, contents, episode, metadata, psnr, record, rows_of, schema};

/// The formats of this build that are folders.
fn formats() -> Vec<&'static str> {
    ["folder", "video"].into_iter().filter(|name| by_name(built_in(), name).is_ok()).collect()
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets").join(name)
}

#[test]
fn episodes_come_back_as_they_were() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        assert_eq!(record(&path, WriteMode::Error, 0..3).unwrap(), 0);
        assert_eq!(record(&path, WriteMode::Append, 3..5).unwrap(), 3);
        let read = contents(&path);
        assert_eq!(read.len(), 5, "{name}");
        for (index, batch) in read.iter().enumerate() {
            assert_alike(&episode(&schema(), index, rows_of(index)), batch);
            assert!(batch.get::<i32>("ep_idx").unwrap().iter().all(|&value| value == index as i32));
        }
        let dataset = open(&path).unwrap();
        assert_eq!((dataset.info().format, dataset.metadata()), (name, Some(&metadata())));
        let goal = &dataset.schema().fields()[dataset.schema().index("goal").unwrap()];
        assert_eq!((goal.kind, &goal.shape[..]), (FieldKind::Episode, &[40, 40, 3][..]));
        // Only the dataset is left, and it opens under any name.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let renamed = folder.path().join("renamed");
        fs::rename(&path, &renamed).unwrap();
        assert_eq!(open(&renamed).unwrap().info().format, name);
        assert_eq!(record(&renamed, WriteMode::Append, 0..1).unwrap(), 5);
    }
}

#[test]
fn windows_and_strides_of_every_column() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Append, 0..3).unwrap();
        let whole = contents(&path);
        let mut dataset = open(&path).unwrap();
        let schema = dataset.schema().clone();
        for (index, first, count, stride) in
            [(2, 290, 10, 1), (2, 7, 3, 40), (0, 0, 5, 1), (2, 100, 1, 1), (1, 0, 1, 1)]
        {
            for (column, field) in schema.fields().iter().enumerate() {
                let mut out = Column::zeros(field.dtype, count * field.dim());
                let steps = Steps { first, count, stride };
                dataset.read_column(column, index, steps, out.as_slice_mut()).unwrap();
                let mut expected = Column::zeros(field.dtype, 0);
                for step in 0..count {
                    assert!(expected.extend(whole[index].row(first + step * stride).at(column)));
                }
                assert!(
                    bits(&out) == bits(&expected),
                    "{name}: `{}` of episode {index}, {steps:?}",
                    field.name
                );
            }
        }
    }
}

#[test]
fn equal_content_makes_equal_files() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|file| folder.path().join(file).with_extension(name));
        record(&a, WriteMode::Append, 0..2).unwrap();
        record(&b, WriteMode::Append, 0..1).unwrap();
        record(&b, WriteMode::Append, 1..2).unwrap();
        let files = |path: &Path| {
            let mut files: Vec<_> = walk(path)
                .into_iter()
                .map(|file| {
                    let bytes = fs::read(&file).unwrap();
                    (file.strip_prefix(path).unwrap().to_owned(), bytes)
                })
                .collect();
            files.sort();
            files
        };
        assert!(files(&a) == files(&b), "{name}");
    }
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[test]
fn modes_locks_and_misfits() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Error, 0..2).unwrap();
        assert!(record(&path, WriteMode::Error, 0..1).unwrap_err().to_string().contains("exists already"));
        let first = create(&path, WriteMode::Append, None).unwrap();
        assert!(matches!(create(&path, WriteMode::Append, None).err(), Some(DataError::Busy { .. })));
        drop(first);
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        let other = Metadata { env: "swm/Other-v1".into(), ..metadata() };
        assert!(writer.begin(&schema(), &other).unwrap_err().to_string().contains("swm/Other-v1"));
        drop(writer);
        assert_eq!(record(&path, WriteMode::Overwrite, 2..3).unwrap(), 0);
        assert_eq!(contents(&path).len(), 1);
        // A folder that is no dataset is never replaced.
        let private = folder.path().join("private").with_extension(name);
        fs::create_dir(&private).unwrap();
        fs::write(private.join("letter.txt"), "dear").unwrap();
        let message = record(&private, WriteMode::Overwrite, 0..1).unwrap_err().to_string();
        assert!(message.contains("no dataset in the format"), "{message}");
        assert!(private.join("letter.txt").exists());
        let begin = |field: Field| {
            let mut writer =
                create(&folder.path().join("new").with_extension(name), WriteMode::Append, None).unwrap();
            let schema = swm_core::Schema::new(vec![field]).unwrap();
            writer.begin(&schema, &metadata()).unwrap_err().to_string()
        };
        assert!(begin(Field::step("../x", swm_core::Dtype::F64, &[])).contains("cannot name a column"));
        assert!(begin(Field::step("ep_len", swm_core::Dtype::F64, &[])).contains("reserved"));
    }
}

#[test]
fn quality_is_as_asked() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let written = |quality: Option<u8>| {
            let path = folder.path().join(format!("{quality:?}")).with_extension(name);
            let options = WriteOptions::default().quality(quality);
            let mut writer = create_with(&path, &options, None).unwrap();
            writer.begin(&schema(), &metadata()).unwrap();
            let rows = episode(&schema(), 2, 30);
            writer.write_episode(&rows).unwrap();
            drop(writer);
            let pixels = rows.get::<u8>("pixels").unwrap().to_vec();
            psnr(&pixels, contents(&path)[0].get::<u8>("pixels").unwrap())
        };
        let [low, usual, high] = [Some(10), None, Some(100)].map(written);
        assert!(low + 3.0 < usual && usual < high, "{name}: {low}, {usual}, {high} dB");
    }
}

#[test]
fn a_changed_byte_is_found_in_images_and_numbers() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Append, 0..3).unwrap();
        let check = || {
            let mut dataset = open(&path).unwrap();
            (0..3).filter(|&episode| dataset.check_episode(episode).is_err()).collect::<Vec<_>>()
        };
        assert!(check().is_empty());
        let images = if name == "folder" { "pixels/ep_2_step_7.jpeg" } else { "pixels/ep_2.mp4" };
        for (file, at, episode) in [("state.npz", 400, 0), (images, 300, 2)] {
            let file = path.join(file);
            let good = fs::read(&file).unwrap();
            let mut bad = good.clone();
            bad[at] ^= 4;
            fs::write(&file, bad).unwrap();
            assert_eq!(check(), [episode], "{}", file.display());
            fs::write(&file, good).unwrap();
        }
        fs::remove_file(path.join(images)).unwrap();
        assert_eq!(check(), [2]);
    }
}

/// What numpy and PyAV read of the same files.
#[test]
fn folders_of_the_reference() {
    let expected: serde_json::Value =
        serde_json::from_slice(&fs::read(golden("expected_folders.json")).unwrap()).unwrap();
    for name in formats() {
        let path = golden(&format!("pusht_up_64_{name}"));
        let facts = &expected[format!("pusht_up_64_{name}")];
        let dataset = open(&path).unwrap();
        assert_eq!((dataset.info().format, dataset.num_episodes(), dataset.metadata()), (name, 4, None));
        assert!(dataset.info().skipped.is_empty(), "{:?}", dataset.info().skipped);
        let episodes = contents(&path);
        let mut columns = 0;
        for (at, field) in dataset.schema().fields().iter().enumerate() {
            let fact = &facts[&field.name];
            let rows: usize = episodes.iter().map(swm_core::Batch::rows).sum();
            let shape: Vec<usize> = [rows].into_iter().chain(field.shape.iter().copied()).collect();
            assert_eq!(serde_json::json!(shape), fact["shape"], "{name}: {}", field.name);
            assert_eq!(field.dtype.name(), fact["dtype"], "{name}: {}", field.name);
            let bytes: Vec<u8> =
                episodes.iter().flat_map(|episode| bits(&episode.column(at).to_column())).collect();
            if field.shape.len() == 3 {
                // Two decoders may differ in the last bit of a value; the means of frames hardly do.
                let means = fact["frame_means"].as_array().unwrap();
                for (row, (frame, mean)) in bytes.chunks_exact(64 * 64 * 3).zip(means).enumerate() {
                    let found = frame.iter().map(|&value| f64::from(value)).sum::<f64>() / frame.len() as f64;
                    let mean = mean.as_f64().unwrap();
                    assert!((found - mean).abs() < 0.6, "{name} frame {row}: {found}, not {mean}");
                }
            } else {
                assert_eq!(u64::from(crc32fast::hash(&bytes)), fact["crc32"], "{name}: {}", field.name);
            }
            columns += 1;
        }
        assert_eq!(columns, facts.as_object().unwrap().len());
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        let message = writer.begin(&schema(), &metadata()).unwrap_err().to_string();
        assert!(message.contains("another program"), "{message}");
    }
}

#[test]
fn metadata_that_leaves_the_folder_is_refused() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Append, 0..1).unwrap();
        let manifest = path.join("ep_len.json");
        let text = fs::read_to_string(&manifest).unwrap();
        for column in ["reward", "pixels"] {
            let crafted = text.replace(&format!("\"{column}\""), &format!("\"../{column}\""));
            fs::write(&manifest, crafted).unwrap();
            let message = open(&path).err().unwrap().to_string();
            assert!(message.contains("outside the folder"), "{message}");
        }
    }
}

#[test]
fn an_interrupted_folder_is_repaired_on_request() {
    for name in formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Append, 0..2).unwrap();
        let repair = |apply| by_name(built_in(), name).unwrap().repair(&path, apply).unwrap();
        assert!(repair(false).is_empty());
        let array = path.join("state.npz");
        let bytes = fs::read(&array).unwrap();
        fs::write(&array, &bytes[..bytes.len() - 100]).unwrap();
        let leftover =
            path.join(if name == "folder" { "pixels/ep_2_step_0.jpeg" } else { "pixels/ep_2.mp4" });
        fs::write(&leftover, "half").unwrap();
        assert_eq!(contents(&path).len(), 2);
        let plan = repair(false);
        assert_eq!(plan.len(), 2, "{plan:?}");
        assert!(plan[0].contains("state.npz") && plan[1].contains("1 images"), "{plan:?}");
        assert!(leftover.exists());
        assert_eq!(repair(true), plan);
        assert!(repair(false).is_empty() && !leftover.exists());
        assert!(fs::read(&array).unwrap() == bytes);
        assert_eq!(contents(&path).len(), 2);
    }
}

/// Two episodes in a folder of ours, without one of its files.
fn without(name: &str, file: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data").with_extension(name);
    record(&path, WriteMode::Append, 0..2).unwrap();
    let file = path.join(file);
    let removed = if file.is_dir() { fs::remove_dir_all(file) } else { fs::remove_file(file) };
    removed.unwrap();
    (folder, path)
}

#[test]
fn an_index_that_is_gone_is_named_and_made_anew_on_request() {
    for name in formats() {
        let format = by_name(built_in(), name).unwrap();
        let (_folder, path) = without(name, "ep_len.index");
        let message = open(&path).err().expect("it is refused").to_string();
        let fix = "`swm verify` with `fix`";
        for part in ["`ep_len.index` is missing", "incomplete copy", "the 2 episodes of `ep_len.npz`", fix] {
            assert!(message.contains(part), "{part}: {message}");
        }
        let plan = format.repair(&path, false).unwrap();
        assert_eq!(plan, ["restore the records of the last 2 episodes, which the index lacks"]);
        assert!(open(&path).is_err());
        assert_eq!(format.repair(&path, true).unwrap(), plan);
        assert!(format.repair(&path, false).unwrap().is_empty());
        for (index, batch) in contents(&path).iter().enumerate() {
            assert_alike(&episode(&schema(), index, rows_of(index)), batch);
        }
        assert_eq!(record(&path, WriteMode::Append, 2..3).unwrap(), 2);

        // That of the reference is made from ours.
        for file in ["ep_len.npz", "ep_offset.npz"] {
            let (_folder, path) = without(name, file);
            assert_eq!((open(&path).unwrap().info().format, contents(&path).len()), (name, 2), "{file}");
            let plan = format.repair(&path, true).unwrap();
            assert!(plan.len() == 1 && plan[0].contains(file), "{plan:?}");
            assert!(format.repair(&path, false).unwrap().is_empty() && path.join(file).is_file());
        }
    }
}

#[test]
fn files_that_no_repair_brings_back_are_named() {
    for name in formats() {
        let told = |path: &Path| open(path).err().expect("it is refused").to_string();
        for (file, lost) in [("state.npz", "`state.npz`"), ("pixels", "`pixels`")] {
            let (_folder, path) = without(name, file);
            let message = told(&path);
            for part in [&format!("{lost} is missing, which holds the column"), "copy it again"] {
                assert!(message.contains(part), "{message}");
            }
            assert_eq!(
                by_name(built_in(), name).unwrap().repair(&path, true).unwrap_err().to_string(),
                message
            );
        }
        let (_folder, path) = without(name, "ep_len.index");
        fs::remove_file(path.join("ep_len.npz")).unwrap();
        let message = told(&path);
        assert!(
            message.contains("`ep_len.index` is missing") && message.contains("copy it again"),
            "{message}"
        );

        // Episodes without a description are neither another program's nor a recording that had not begun.
        let (_folder, path) = without(name, "ep_len.json");
        assert!(told(&path).contains("`ep_len.json` is missing, which describes the columns"));
        let refused = create(&path, WriteMode::Append, None).map(drop).unwrap_err();
        assert!(refused.to_string().contains("`ep_len.json` is missing"), "{refused}");
    }
    // Folders of the reference.
    for (file, holds) in [("ep_len.npz", "the lengths"), ("ep_offset.npz", "the first row")] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.folder");
        copied(&golden("pusht_up_64_folder"), &path);
        fs::remove_file(path.join(file)).unwrap();
        let message = open(&path).err().expect("it is refused").to_string();
        assert!(message.contains(&format!("`{file}` is missing, which holds {holds}")), "{message}");
    }
}

#[test]
fn a_replacement_that_is_killed_early_leaves_a_folder_to_record_into() {
    for name in formats() {
        let (_folder, path) = without(name, "ep_len.json");
        fs::OpenOptions::new().write(true).open(path.join("ep_len.index")).unwrap().set_len(8).unwrap();
        assert_eq!(record(&path, WriteMode::Error, 0..1).ok(), None);
        assert_eq!(record(&path, WriteMode::Overwrite, 0..1).unwrap(), 0);
        assert_eq!(contents(&path).len(), 1);
    }
}
