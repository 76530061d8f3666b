//! Nothing outside of a dataset is changed by recording into it or repairing it, and no recording succeeds without its
//! dataset.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use swm_data::format::{by_name, detect};
use swm_data::{DataError, WriteMode};

use crate::support::{assert_alike, contents, episode, metadata, mutations, record, rows_of, schema};
use crate::{FORMATS, create, open, registry};

/// The formats of this build that are folders of arrays.
fn folders() -> Vec<&'static str> {
    ["folder", "video"].into_iter().filter(|name| by_name(registry(), name).is_ok()).collect()
}

fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    detect(registry(), path).unwrap().repair(path, apply)
}

/// Every file of a folder with its content.
fn image(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    mutations::files(path).into_iter().map(|file| (file.clone(), fs::read(&file).unwrap())).collect()
}

/// The first episodes of a recording, in full.
fn assert_holds(path: &Path, episodes: usize) {
    let read = contents(path);
    assert_eq!(read.len(), episodes);
    for (index, batch) in read.iter().enumerate() {
        assert_alike(&episode(&schema(), index, rows_of(index)), batch);
    }
}

#[test]
fn episodes_that_the_index_lost_are_restored_and_not_deleted() {
    for name in folders() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Error, 0..4).unwrap();
        let good = image(&path);
        let index = path.join("ep_len.index");
        let bytes = fs::read(&index).unwrap();
        let record_bytes = (bytes.len() - 8) / 4;
        for kept in [bytes.len() - record_bytes, 8 + 2 * record_bytes, 8 + record_bytes / 2, 8, 0] {
            fs::write(&index, &bytes[..kept]).unwrap();
            // Nothing is lost to a reader, and the index is to be repaired.
            assert_holds(&path, 4);
            let plan = repair(&path, false).unwrap();
            assert!(plan[0].contains("restore the records"), "{plan:?}");
            assert_eq!(repair(&path, true).unwrap(), plan);
            assert!(image(&path) == good, "{name}, {kept} bytes");
        }
        // An append restores it as well.
        fs::write(&index, &bytes[..8 + record_bytes]).unwrap();
        assert_eq!(record(&path, WriteMode::Append, 4..5).unwrap(), 4);
        assert_holds(&path, 5);
        assert!(repair(&path, false).unwrap().is_empty());
    }
}

#[test]
fn nothing_is_deleted_that_the_lengths_contradict() {
    for name in folders() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(name);
        record(&path, WriteMode::Error, 0..3).unwrap();
        let index = path.join("ep_len.index");
        let bytes = fs::read(&index).unwrap();
        fs::write(&index, &bytes[..8 + (bytes.len() - 8) / 3]).unwrap();
        let gone = path.join(if name == "folder" { "pixels/ep_2_step_7.jpeg" } else { "pixels/ep_2.mp4" });
        fs::remove_file(gone).unwrap();
        let before = image(&path);
        for message in [
            open(&path).err().unwrap().to_string(),
            repair(&path, true).unwrap_err().to_string(),
            record(&path, WriteMode::Append, 3..4).unwrap_err().to_string(),
        ] {
            assert!(
                message.contains("damaged") && message.contains("2 episodes more than the index"),
                "{message}"
            );
        }
        assert!(image(&path) == before);
    }
}

#[test]
fn links_in_a_folder_are_read_and_not_written_through() {
    for format in FORMATS.iter().filter(|format| !["hdf5", "mcap"].contains(&format.name)) {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a", "b"].map(|name| folder.path().join(name).with_extension(format.name));
        record(&path, WriteMode::Error, 0..2).unwrap();
        record(&other, WriteMode::Error, 0..5).unwrap();
        let before = image(&other);
        let parts = match format.name {
            "lerobot" => ["data", "meta/info.json"],
            _ => ["pixels", "state.npz"],
        };
        for part in parts {
            let (here, kept) = (path.join(part), folder.path().join("kept"));
            fs::rename(&here, &kept).unwrap();
            symlink(other.join(part), &here).unwrap();
            for error in [
                record(&path, WriteMode::Append, 2..3).unwrap_err().to_string(),
                record(&path, WriteMode::Overwrite, 2..3).unwrap_err().to_string(),
                repair(&path, true).unwrap_err().to_string(),
            ] {
                assert!(error.contains(part) && error.contains("symbolic link"), "{}: {error}", format.name);
            }
            // Without a repair, nobody counts images of the other dataset as leftovers.
            let plan = repair(&path, false).unwrap_or_default();
            assert!(plan.iter().all(|step| !step.contains("images")), "{plan:?}");
            fs::remove_file(&here).unwrap();
            fs::rename(&kept, &here).unwrap();
        }
        assert!(image(&other) == before, "{}", format.name);
        // Read through a link, all is well.
        fs::rename(path.join(parts[0]), folder.path().join("kept")).unwrap();
        symlink(folder.path().join("kept"), path.join(parts[0])).unwrap();
        assert_holds(&path, 2);
    }
}

#[test]
fn foreign_files_between_images_stay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    record(&path, WriteMode::Error, 0..1).unwrap();
    let [note, left] = ["pixels/ep_7_notes.txt", "pixels/ep_7_step_0.jpeg"].map(|name| path.join(name));
    fs::write(&note, "mine").unwrap();
    fs::write(&left, "half").unwrap();
    assert_eq!(repair(&path, true).unwrap().len(), 1);
    assert!(note.exists() && !left.exists());
}

#[test]
fn a_file_shared_with_another_dataset_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let [path, other] = ["a.folder", "b.folder"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Error, 0..2).unwrap();
    record(&other, WriteMode::Error, 0..2).unwrap();
    fs::remove_file(path.join("state.npz")).unwrap();
    fs::hard_link(other.join("state.npz"), path.join("state.npz")).unwrap();
    let before = image(&other);
    let error = record(&path, WriteMode::Append, 2..3).unwrap_err().to_string();
    assert!(error.contains("state.npz") && error.contains("hard links"), "{error}");
    assert!(image(&other) == before);
}

#[test]
fn locks_and_drafts_that_are_links_are_not_followed() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        let [lock, draft] =
            ["lock", "new"].map(|end| folder.path().join(format!("data.{}.{end}", format.extensions[0])));
        let letter = folder.path().join("letter.txt");
        fs::write(&letter, "dear").unwrap();
        for target in [&letter, &folder.path().join("nowhere")] {
            symlink(target, &lock).unwrap();
            let error = record(&path, WriteMode::Error, 0..1).unwrap_err().to_string();
            assert!(error.contains(".lock") && error.contains("symbolic link"), "{error}");
            fs::remove_file(&lock).unwrap();
        }
        symlink(&letter, &draft).unwrap();
        record(&path, WriteMode::Error, 0..1).unwrap();
        assert_holds(&path, 1);
        assert_eq!(fs::read(&letter).unwrap(), b"dear");
        assert!(!folder.path().join("nowhere").exists());
    }
}

#[test]
fn no_recording_succeeds_without_its_dataset() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        for moved in [false, true] {
            fs::create_dir(&inner).unwrap();
            let path = inner.join("data").with_extension(format.extensions[0]);
            let mut writer = create(&path, WriteMode::Error, None).unwrap();
            writer.begin(&schema(), &metadata()).unwrap();
            writer.write_episode(&episode(&schema(), 0, 5)).unwrap();
            match moved {
                true => fs::rename(&inner, folder.path().join("elsewhere")).unwrap(),
                false => fs::remove_dir_all(&inner).unwrap(),
            }
            let error = writer.write_episode(&episode(&schema(), 1, 5)).map(|()| writer.finish());
            // A folder may have noticed before that its files are gone.
            assert!(error.is_err(), "{}", format.name);
            // Closing says so, too.
            fs::create_dir_all(&inner).unwrap();
            let again = inner.join("again").with_extension(format.extensions[0]);
            let mut writer = create(&again, WriteMode::Error, None).unwrap();
            writer.begin(&schema(), &metadata()).unwrap();
            writer.write_episode(&episode(&schema(), 0, 5)).unwrap();
            fs::remove_dir_all(&inner).unwrap();
            let message = writer.finish().unwrap_err().to_string();
            assert!(message.contains("removed, moved or replaced"), "{}: {message}", format.name);
        }
    }
}

#[test]
fn two_names_of_a_file_have_no_two_writers() {
    for format in FORMATS.iter().filter(|format| ["hdf5", "mcap"].contains(&format.name)) {
        let folder = tempfile::tempdir().unwrap();
        let [path, twin] =
            ["a", "b"].map(|name| folder.path().join(name).with_extension(format.extensions[0]));
        record(&path, WriteMode::Error, 0..2).unwrap();
        let mut first = create(&path, WriteMode::Append, None).unwrap();
        first.begin(&schema(), &metadata()).unwrap();
        fs::hard_link(&path, &twin).unwrap();
        for error in [
            record(&twin, WriteMode::Append, 2..3).unwrap_err().to_string(),
            repair(&twin, true).unwrap_err().to_string(),
        ] {
            assert!(error.contains("2 names (hard links)"), "{error}");
        }
        first.write_episode(&episode(&schema(), 2, rows_of(2))).unwrap();
        first.finish().unwrap();
        assert_holds(&path, 3);
        // To replace it takes only one of the names away.
        record(&twin, WriteMode::Overwrite, 0..1).unwrap();
        assert_holds(&path, 3);
        assert_holds(&twin, 1);
    }
}
