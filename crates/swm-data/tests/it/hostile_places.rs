//! Every file of a dataset of every format, with something else in its place: links to what lies outside, to a device, to
//! itself; a pipe; a folder; nothing; a trillion bytes without content. Reading, repairing and continuing end soon, without a
//! panic, and change nothing outside of the dataset.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use swm_data::testing::mutations::files;
use swm_data::{WriteMode, format};

use crate::support::{episode, metadata};
use crate::{FORMATS, create, open, play, registry, seed};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Trick {
    LinkToText,
    LinkToOtherDataset,
    LinkToDevice,
    LinkToItself,
    Pipe,
    Folder,
    Empty,
    Sparse,
}

const TRICKS: [Trick; 8] = [
    Trick::LinkToText,
    Trick::LinkToOtherDataset,
    Trick::LinkToDevice,
    Trick::LinkToItself,
    Trick::Pipe,
    Trick::Folder,
    Trick::Empty,
    Trick::Sparse,
];

impl Trick {
    /// Puts something in the place of `file`; `outside` has a text and, under the same name as here, the file of another
    /// dataset.
    fn play(self, file: &Path, text: &Path, other: &Path) {
        fs::remove_file(file).unwrap();
        match self {
            Trick::LinkToText => symlink(text, file).unwrap(),
            Trick::LinkToOtherDataset => symlink(other, file).unwrap(),
            Trick::LinkToDevice => symlink("/dev/zero", file).unwrap(),
            Trick::LinkToItself => symlink(file, file).unwrap(),
            Trick::Pipe => assert!(Command::new("mkfifo").arg(file).status().unwrap().success()),
            Trick::Folder => fs::create_dir(file).unwrap(),
            Trick::Empty => fs::write(file, []).unwrap(),
            Trick::Sparse => fs::File::create(file).unwrap().set_len(1 << 40).unwrap(),
        }
    }
}

fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        fs::copy(from, to).unwrap();
        return;
    }
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        copy(&entry.path(), &to.join(entry.file_name()));
    }
}

fn remove(path: &Path) {
    let _ =
        if path.is_dir() && !path.is_symlink() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
}

/// Names and content of everything in a folder.
fn everything(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    files(folder).into_iter().map(|file| (file.clone(), fs::read(file).unwrap())).collect()
}

#[test]
fn what_stands_in_the_place_of_a_file_does_no_harm() {
    let mut tried = 0;
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let name = format!("data.{}", format.extensions[0]);
        let [sound, outside, here] = ["sound", "outside", "here"].map(|name| folder.path().join(name));
        for folder in [&sound, &outside, &here] {
            fs::create_dir(folder).unwrap();
        }
        let (sound, other, path) = (sound.join(&name), outside.join(&name), here.join(&name));
        seed(&sound);
        copy(&sound, &other);
        let text = outside.join("text");
        fs::write(&text, "a text that is no dataset\n").unwrap();
        let before = everything(&outside);
        let schema = open(&sound).unwrap().schema().clone();
        for file in files(&sound) {
            let part = file.strip_prefix(&sound).unwrap();
            let is_whole = part.as_os_str().is_empty();
            for trick in TRICKS {
                // A dataset may be opened and continued by a link to it.
                if is_whole && trick == Trick::LinkToOtherDataset {
                    continue;
                }
                remove(&path);
                copy(&sound, &path);
                let join = |folder: &Path| if is_whole { folder.to_owned() } else { folder.join(part) };
                trick.play(&join(&path), &text, &join(&other));
                let start = Instant::now();
                play(&path);
                if let Some(format) = format::detect(registry(), &path) {
                    let _ = format.repair(&path, true);
                }
                if let Ok(mut writer) = create(&path, WriteMode::Append, None)
                    && writer.begin(&schema, &metadata()).is_ok()
                    && writer.write_episode(&episode(&schema, 2, 4)).is_ok()
                {
                    let _ = writer.finish();
                }
                let took = start.elapsed();
                let what = format!("{}: {trick:?} in the place of {}", format.name, part.display());
                assert!(took < Duration::from_secs(20), "{what}: {took:?}");
                assert!(everything(&outside) == before, "{what}: changed a file outside");
                let around: Vec<_> =
                    fs::read_dir(&here).unwrap().map(|entry| entry.unwrap().file_name()).collect();
                assert!(around.iter().all(|there| *there == *name), "{what}: left {around:?}");
                tried += 1;
            }
        }
        remove(&path);
    }
    assert!(tried >= 50 * FORMATS.len(), "{tried} hostile datasets");
}
