//! Recordings without images whose bytes have changed: opening, reading and drawing them gives an error or other
//! images, never a panic or a hang. What holds images is tested with each format.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swm::core::dataset::CHECKPOINT;
use swm::core::env::PIXELS;
use swm::core::{Batch, ImageSize, MAX_FRAME_SKIP, SliceMut};
use swm::data::testing::mutations::{mutate_for, play};
use swm::data::tools::copy::{all, copy};
use swm::data::{Dataset, MemoryDataset, RenderOptions, Rendered, Steps, WriteOptions};

use crate::replayable::record;
use crate::support::{Folder, PUSHT};

/// Of an image.
const SIDE: usize = 16;
/// Changes to the saved states of an environment.
const CHANGES: usize = 48;

fn options(verify: bool) -> RenderOptions {
    RenderOptions::default().image(ImageSize { height: SIDE, width: SIDE }).verify(verify)
}

/// Draws rows near the first and the last checkpoint, and replays what is not absurdly long; whether all of it went well.
fn draw(dataset: Box<dyn Dataset>, verify: bool) -> bool {
    let Ok(mut drawn) = Rendered::new(dataset, &swm::registry(), &options(verify)) else { return false };
    let Some(column) = drawn.schema().index(PIXELS) else { return false };
    let mut image = vec![0; SIDE * SIDE * 3];
    let mut sound = true;
    for episode in 0..drawn.num_episodes().min(4) {
        let len = drawn.episode_len(episode).min(100);
        for row in [len.saturating_sub(1), 9.min(len.saturating_sub(1)), 0] {
            let steps = Steps { first: row, count: 1, stride: 1 };
            sound &= drawn.read_column(column, episode, steps, SliceMut::U8(&mut image)).is_ok();
        }
        sound &= !verify || drawn.episode_len(episode) > 100 || drawn.verify(episode).is_ok();
    }
    sound
}

fn open_and_draw(path: &Path) -> bool {
    play(path) && swm::data::open(path).is_ok_and(|dataset| draw(dataset, true))
}

#[test]
fn changed_files_are_refused_or_drawn() {
    let folder = Folder::new();
    let path = folder.path("small.h5");
    let entry = swm::registry().env(PUSHT).unwrap();
    let mut sources: Vec<Box<dyn Dataset>> = vec![Box::new(record(entry, false, 1).unwrap())];
    let pieces = all(&sources);
    copy(&mut sources, &pieces, Path::new(&path), (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    mutate_for("replayable hdf5", Path::new(&path), &mut open_and_draw);
}

/// Saved states are an environment's own bytes, which no checksum of a format protects from a program that writes nonsense.
#[test]
fn changed_states_are_refused_or_drawn() {
    for entry in swm::envs_2d::ENVS {
        let small = record(entry, false, 1).unwrap();
        let mut rows = Batch::new(small.schema().clone(), 0);
        small.clone().read(0, 0..small.episode_len(0), &mut rows).unwrap();
        let changed = |change: &dyn Fn(&mut [u8])| -> Box<dyn Dataset> {
            let mut rows = rows.clone();
            let column = rows.schema().require(CHECKPOINT).unwrap();
            let SliceMut::U8(states) = rows.column_mut(column) else { panic!("states are bytes") };
            change(states);
            let metadata = small.metadata().cloned();
            Box::new(
                MemoryDataset::new("changed", small.schema().clone(), metadata, [Arc::new(rows)]).unwrap(),
            )
        };
        assert!(draw(changed(&|_| {}), true), "{}", entry.id);
        let mut refused = 0;
        for number in 0..CHANGES {
            let started = Instant::now();
            // Without comparison, so that what a state says is drawn.
            refused += usize::from(!draw(changed(&|states| overwrite(states, number)), false));
            let took = started.elapsed();
            assert!(took < Duration::from_secs(10), "{}: change {number}: {took:?}", entry.id);
        }
        assert!(refused > 0, "{}: nothing was refused", entry.id);
    }
}

/// Overwrites 8 bytes: with values no simulator meets, or at random.
fn overwrite(states: &mut [u8], number: usize) {
    let random = (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let odd = [f64::NAN, f64::INFINITY, -1e300, 1e18, 0.0, f64::MIN_POSITIVE];
    let word = match number % 4 {
        3 => random.to_le_bytes(),
        _ => odd[number / 4 % odd.len()].to_le_bytes(),
    };
    // The states of the rows 0 and 8, from which rows are drawn.
    let at = (random >> 20) as usize % (states.len() / 2);
    for (byte, value) in states[at..].iter_mut().zip(word) {
        *byte = value;
    }
}

#[test]
fn what_no_recording_states_is_refused() {
    let entry = swm::registry().env(PUSHT).unwrap();
    let small = record(entry, false, 1).unwrap();
    let mut rows = Batch::new(small.schema().clone(), 0);
    small.clone().read(0, 0..small.episode_len(0), &mut rows).unwrap();
    let mut metadata = small.metadata().cloned().unwrap();
    metadata.frame_skip = MAX_FRAME_SKIP + 1;
    let hours =
        MemoryDataset::new("hours", small.schema().clone(), Some(metadata), [Arc::new(rows)]).unwrap();
    let error = Rendered::new(Box::new(hours), &swm::registry(), &options(true)).err().unwrap().to_string();
    assert!(error.contains("frame skip of 1001"), "{error}");
}
