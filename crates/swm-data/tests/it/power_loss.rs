//! Recordings that lose power: what was written and not synced is gone. A recording runs with a library before the C library
//! that keeps files and folders as they are when they are synced (`power_loss.c`); what it kept is the dataset after the
//! loss, with none of the later writes, or with some pages of them.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use swm_core::Batch;
use swm_data::WriteMode;
use swm_data::testing::kills::last;
use swm_data::testing::mutations::files;

use crate::support::{assert_alike, contents, episode, metadata, record, rounds, rows_of, schema};
use crate::{FORMATS, create, open};

/// Names the dataset to the process that records.
const TARGET: &str = "SWM_DATA_TEST_POWER";
/// Names the folder of what was synced.
const DISK: &str = "SWM_TEST_DISK";
/// Set where the recording ends by itself.
const ENDS: &str = "SWM_DATA_TEST_ENDS";
/// Episodes after the last that was synced.
const MORE: usize = 3;

/// Where [`TARGET`] is set: records until something was synced, and then more, until the power is lost or it ends.
#[test]
fn record_until_the_power_is_lost() {
    let Some(path) = std::env::var_os(TARGET) else { return };
    let schema = schema();
    let mut writer = create(Path::new(&path), WriteMode::Error, None).unwrap();
    writer.begin(&schema, &metadata()).unwrap();
    let mut write = |index| writer.write_episode(&episode(&schema, index, rows_of(index))).unwrap();
    // Syncs come about once a second, and more rarely where they take long.
    let mut synced = 0;
    loop {
        let before = last_sync();
        write(synced);
        synced += 1;
        if synced > 3 && last_sync() > before {
            break;
        }
        std::thread::sleep(Duration::from_millis(300));
    }
    println!("\nsynced {synced}");
    (synced..synced + MORE).for_each(&mut write);
    println!("written {}", synced + MORE);
    if std::env::var_os(ENDS).is_some() {
        writer.finish().unwrap();
        return;
    }
    std::thread::sleep(Duration::from_secs(600));
}

/// When a file or folder was synced last.
fn last_sync() -> Option<SystemTime> {
    let kept = fs::read_dir(std::env::var_os(DISK)?).unwrap();
    kept.filter_map(|entry| entry.ok()?.metadata().ok()?.modified().ok()).max()
}

/// What a recording of `name` left: a folder that is synced, and the folder of what was kept.
struct Lost {
    folder: tempfile::TempDir,
    name: String,
    /// Episodes that were synced.
    synced: usize,
}

impl Lost {
    /// Records, to the end if `ends`, and loses power.
    fn record(name: &str, ends: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [library, disk, here] = ["keep.so", "disk", "here"].map(|name| folder.path().join(name));
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../swm-data/tests/it/power_loss.c");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-o"])
            .args([&library, &source])
            .arg("-ldl")
            .status()
            .expect("a C compiler, which HDF5 is built with too");
        assert!(compiled.success());
        fs::create_dir(&disk).unwrap();
        fs::create_dir(&here).unwrap();
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args([
            "--exact",
            "power_loss::record_until_the_power_is_lost",
            "--nocapture",
            "--test-threads=1",
        ]);
        command.env("LD_PRELOAD", &library).env(DISK, &disk).env(TARGET, here.join(name));
        if ends {
            command.env(ENDS, "1");
        }
        let mut process = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut lines = Vec::new();
        for line in output.by_ref() {
            lines.push(line);
            if last(&lines, "written ").is_some() {
                break;
            }
        }
        let synced = last(&lines, if ends { "written " } else { "synced " }).expect(name);
        if !ends {
            process.kill().unwrap();
        }
        assert_eq!(process.wait().unwrap().success(), ends, "{name}");
        Self { folder, name: name.to_owned(), synced }
    }

    /// The folder as its last sync left it, below a new one.
    fn restored(&self) -> PathBuf {
        let to = self.folder.path().join("restored");
        let _ = fs::remove_dir_all(&to);
        let there = fs::metadata(self.folder.path().join("here")).unwrap();
        let born = there.created().unwrap().duration_since(UNIX_EPOCH).unwrap();
        let key = format!("{}.{}.{}", there.ino(), born.as_secs(), born.subsec_nanos());
        restore(&self.folder.path().join("disk"), &key, true, &to);
        to.join(&self.name)
    }

    /// The dataset as the program left it, of which the system may have written any page.
    fn written(&self) -> PathBuf {
        self.folder.path().join("here").join(&self.name)
    }
}

/// Puts what was kept of a file or folder at `to`; of what was never synced, a name.
fn restore(disk: &Path, key: &str, is_folder: bool, to: &Path) {
    if !is_folder {
        match fs::copy(disk.join(key), to) {
            Ok(_) => {}
            Err(_) => fs::write(to, []).unwrap(),
        }
        return;
    }
    fs::create_dir(to).unwrap();
    for line in fs::read_to_string(disk.join(key)).unwrap_or_default().lines() {
        let [key, kind, name] = line.splitn(3, ' ').collect::<Vec<_>>()[..] else { panic!("{line}") };
        restore(disk, key, kind == "folder", &to.join(name));
    }
}

/// File names of every format that this build writes.
fn names() -> impl Iterator<Item = String> {
    FORMATS.iter().filter_map(|format| Some(format!("data.{}", format.extensions.first()?)))
}

/// The dataset holds at least `least` episodes, all of them as they were recorded, and can be continued.
fn assert_kept(path: &Path, least: usize) {
    let read = contents(path);
    assert!(read.len() >= least, "{}: {} episodes of {least} are there", path.display(), read.len());
    for (index, batch) in read.iter().enumerate() {
        assert_alike(&episode(&schema(), index, rows_of(index)), batch);
    }
    record(path, WriteMode::Append, read.len()..read.len() + 1).unwrap();
    let mut dataset = open(path).unwrap();
    assert_eq!(dataset.num_episodes(), read.len() + 1);
    (0..=read.len()).for_each(|episode| dataset.check_episode(episode).unwrap());
}

#[test]
fn what_was_synced_survives_a_power_loss() {
    for name in names() {
        let lost = Lost::record(&name, false);
        assert_kept(&lost.restored(), lost.synced);
    }
}

#[test]
fn a_finished_recording_survives_a_power_loss() {
    for name in names() {
        let lost = Lost::record(&name, true);
        assert_kept(&lost.restored(), lost.synced);
    }
}

/// Bytes that the system writes at once.
const PAGE: usize = 4096;

/// The dataset with some of what was never synced: of every file the old or the new length, of every page the old or the new
/// content. A function of `seed`.
fn mixed(lost: &Lost, seed: u64) -> PathBuf {
    let (old, new) = (lost.restored(), lost.written());
    let to = lost.folder.path().join(format!("mixed{seed}"));
    fs::create_dir(&to).unwrap();
    let to = to.join(&lost.name);
    let mut state = seed;
    let mut coin = move || {
        state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        state >> 63 == 1
    };
    let parts = |folder: &Path| -> Vec<PathBuf> {
        files(folder).iter().map(|file| file.strip_prefix(folder).unwrap().to_owned()).collect()
    };
    let all: BTreeSet<PathBuf> = parts(&old).into_iter().chain(parts(&new)).collect();
    for part in all {
        let join =
            |folder: &Path| if part.as_os_str().is_empty() { folder.to_owned() } else { folder.join(&part) };
        let (before, after) = (fs::read(join(&old)).ok(), fs::read(join(&new)).ok());
        // A name that was made or removed since may be there or not.
        if (before.is_none() || after.is_none()) && coin() {
            continue;
        }
        let (before, after) = (before.unwrap_or_default(), after.unwrap_or_default());
        let len = if coin() { after.len() } else { before.len() };
        let mut bytes = vec![0; len];
        for (index, page) in bytes.chunks_mut(PAGE).enumerate() {
            let source = if coin() { &after } else { &before };
            let source = source.get(index * PAGE..).unwrap_or_default();
            let count = page.len().min(source.len());
            page[..count].copy_from_slice(&source[..count]);
        }
        let target = join(&to);
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::write(target, bytes).unwrap();
    }
    to
}

/// The episodes that can be read, up to the first that cannot.
fn readable(path: &Path) -> Vec<Batch> {
    let Ok(mut dataset) = open(path) else { return Vec::new() };
    let mut episodes = Vec::new();
    for episode in 0..dataset.num_episodes() {
        let mut rows = Batch::new(dataset.schema().clone(), 0);
        if dataset.check_episode(episode).is_err()
            || dataset.read(episode, 0..dataset.episode_len(episode), &mut rows).is_err()
        {
            break;
        }
        episodes.push(rows);
    }
    episodes
}

/// A dataset may then be refused as damaged, but no synced episode reads as another.
#[test]
fn whichever_later_pages_were_written_nothing_synced_reads_as_something_else() {
    for name in names() {
        let lost = Lost::record(&name, false);
        for seed in 0..rounds(6, 60) as u64 {
            for (index, batch) in readable(&mixed(&lost, seed)).iter().take(lost.synced).enumerate() {
                assert_alike(&episode(&schema(), index, rows_of(index)), batch);
            }
        }
    }
}
