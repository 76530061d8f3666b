//! Foreign bytes in every reader: datasets of every format are cut, flipped and overwritten at many places, always the
//! same ones. Whatever comes of it must be an error or other values: never a panic, a hang, or memory without bound.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::{episode, metadata, rounds};
use crate::format::built_in;
use crate::{ReplayBuffer, WriteMode, create_in, open_in};
use swm_core::{Batch, Dtype, Field, Registry, Schema};

/// Numbers that sizes, counts and offsets are overwritten with.
const WORDS: [u32; 6] = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0100_0000];
/// Mutations per file, in a usual run and in a long one.
const PER_FILE: [usize; 2] = [160, 800];
/// Memory that the process may have used in the end.
const MAX_RESIDENT_KIB: u64 = 2 << 20;
/// Growth of the address space that all mutations together may cause.
const MAX_GROWTH_KIB: u64 = 3 << 20;

/// Records a small dataset to change.
pub fn seed(path: &Path) {
    seed_in(built_in(), path);
}

/// As [`seed`], in a format of a registry.
pub fn seed_in(registry: &Registry, path: &Path) {
    let fields = vec![
        Field::step("pixels", Dtype::U8, &[16, 16, 3]),
        Field::step("state", Dtype::F64, &[3]),
        Field::step("task", Dtype::Str, &[]),
        Field::episode("variation.x", Dtype::I64, &[]),
    ];
    let schema = Schema::new(fields).unwrap();
    let mut writer = create_in(registry, path, &WriteMode::Error.into(), None).unwrap();
    writer.begin(&schema, &metadata()).unwrap();
    for (index, rows) in [3, 5].into_iter().enumerate() {
        writer.write_episode(&episode(&schema, index, rows)).unwrap();
    }
    writer.finish().unwrap();
}

/// All files of a dataset.
pub fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let mut found: Vec<PathBuf> =
        fs::read_dir(path).unwrap().flat_map(|entry| files(&entry.unwrap().path())).collect();
    found.sort();
    found
}

/// Mutation `number` of some bytes: a function of both.
pub fn mutated(bytes: &[u8], number: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    // Heads and ends decide most: half of the mutations are there.
    let spread = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
    let at = match number % 4 {
        0 => spread as usize % bytes.len().clamp(1, 256),
        1 => bytes.len() - 1 - spread as usize % bytes.len().clamp(1, 256),
        _ => spread as usize % bytes.len().max(1),
    };
    match number % 5 {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << (number % 8),
        2 => {
            let end = (at + 40).min(bytes.len());
            let copy = bytes[at..end].to_vec();
            bytes.splice(at..at, copy);
        }
        _ => {
            let word = WORDS[number / 5 % WORDS.len()];
            let word = if number.is_multiple_of(2) { word.to_le_bytes() } else { word.to_be_bytes() };
            for (byte, value) in bytes[at..].iter_mut().zip(word) {
                *byte = value;
            }
        }
    }
    bytes
}

/// Opens and reads everything, also into a replay buffer; whether there was no error.
pub fn play(path: &Path) -> bool {
    play_in(built_in(), path)
}

/// As [`play`], in a format of a registry.
pub fn play_in(registry: &Registry, path: &Path) -> bool {
    let Ok(mut dataset) = open_in(registry, path) else { return false };
    let mut sound = dataset.check_whole().is_ok();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    for episode in 0..dataset.num_episodes().min(20) {
        let rows = 0..dataset.episode_len(episode).min(1000);
        sound &= dataset.read(episode, rows, &mut batch).is_ok();
        sound &= dataset.check_episode(episode).is_ok();
    }
    sound & ReplayBuffer::load(dataset.as_mut(), 1000).is_ok()
}

/// The largest address space (`VmPeak`) or memory (`VmHWM`) that this process had, in KiB.
fn peak_kib(kind: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.split(':').next() == Some(kind))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Changes every file of the dataset at `path` again and again, and reads it each time.
pub fn mutate(name: &str, path: &Path) {
    mutate_for(name, path, &mut play);
}

/// As [`mutate`], with another way to use the dataset: `play` says whether there was no error.
pub fn mutate_for(name: &str, path: &Path, play: &mut dyn FnMut(&Path) -> bool) {
    assert!(play(path), "{name}: the seed itself");
    let (started, before) = (Instant::now(), peak_kib("VmPeak"));
    let (mut errors, mut all) = (0, 0);
    for file in files(path) {
        let bytes = fs::read(&file).unwrap();
        for number in 0..rounds(PER_FILE[0], PER_FILE[1]) {
            // A new file, for images may be links to one another.
            fs::remove_file(&file).unwrap();
            fs::write(&file, mutated(&bytes, number)).unwrap();
            let one = Instant::now();
            errors += usize::from(!play(path));
            all += 1;
            let took = one.elapsed();
            assert!(
                took < Duration::from_secs(10),
                "{name}: {}, mutation {number}: {took:?}",
                file.display()
            );
        }
        fs::write(&file, &bytes).unwrap();
    }
    assert!(play(path), "{name}: the seed again");
    assert!(errors * 20 > all, "{name}: {errors} of {all} mutations were noticed");
    if let (Some(before), Some(after)) = (before, peak_kib("VmPeak")) {
        assert!(after - before < MAX_GROWTH_KIB, "{name}: {} MiB more", (after - before) >> 10);
    }
    if let Some(resident) = peak_kib("VmHWM") {
        assert!(resident < MAX_RESIDENT_KIB, "{name}: {} MiB of memory", resident >> 10);
    }
    eprintln!("{name}: {errors} of {all} mutations noticed in {:?}", started.elapsed());
}
