//! Damaged tables: an error or values, without a panic or a hang, and with memory in proportion to the files. A binary of its own, for it
//! counts what is allocated.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

#[path = "it/memory.rs"]
mod memory;

use std::alloc::System;
use std::sync::Arc;
use std::time::{Duration, Instant};

use memory::{DELETED, Memory, TABLES};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm_lance::{Cursor, Kind, LanceError, Table};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Allocations of a whole read together, of which few are there at once: so many times the files…
const RATIO: usize = 40;
/// …and this.
const SLACK: usize = 32 << 20;
const MOST: Duration = Duration::from_secs(5);

/// Reads all of a table; whether there was no error.
fn read(memory: &Memory) -> Result<(), LanceError> {
    let table = Table::open_in(Box::new(memory.clone()))?;
    let (rows, mut cursor) = (table.rows().min(5000) as usize, Cursor::default());
    let mut first_error = Ok(());
    for column in table.columns().iter().filter(|column| !matches!(column.kind, Kind::Other(_))) {
        let all = table.read(column, 0, rows, &mut cursor);
        // Another way through the pages.
        let last = table.read(column, table.rows().saturating_sub(1), rows.min(1), &mut cursor);
        for values in [all, last] {
            match values {
                Ok(values) => {
                    for row in 0..values.rows() {
                        let _ = values
                            .items(row)
                            .map(|item| values.item(item).map_or(0, <[u8]>::len))
                            .sum::<usize>();
                    }
                }
                Err(error) => first_error = Err(error),
            }
        }
    }
    first_error
}

/// Reads a table of which a file has other bytes.
fn check(memory: &mut Memory, path: &str, bytes: Vec<u8>, about: &str, counts: &mut [usize; 2]) {
    let whole: usize = memory.files.values().map(|file| file.len()).sum();
    let sound = memory.files.insert(path.to_owned(), bytes.into());
    let (region, started) = (Region::new(ALLOCATOR), Instant::now());
    let result = read(memory);
    let (allocated, took) = (region.change().bytes_allocated, started.elapsed());
    assert!(allocated < whole * RATIO + SLACK, "{path}, {about}: {allocated} bytes allocated, {result:?}");
    assert!(took < MOST, "{path}, {about}: {took:?}, {result:?}");
    counts[usize::from(result.is_err())] += 1;
    memory.files.extend(sound.map(|sound| (path.to_owned(), sound)));
}

/// Where the metadata of columns begins in a file of rows; manifests are all metadata.
fn metadata_start(path: &str, bytes: &[u8]) -> usize {
    match path.starts_with("data/") {
        false => 0,
        true => {
            bytes[bytes.len() - 40..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes) as usize)
        }
    }
}

/// Bytes that are changed of each file, and cuts; every one with `SWM_ALL_MUTATIONS`.
fn step(of: usize, most: usize) -> usize {
    if std::env::var_os("SWM_ALL_MUTATIONS").is_some() { 1 } else { of.div_ceil(most).max(1) }
}

/// The files that the newest version needs.
fn files(memory: &Memory) -> Vec<(String, Arc<[u8]>)> {
    let is_needed = |path: &str| {
        let mut without = memory.clone();
        without.files.remove(path);
        read(&without).is_err() || path.starts_with("_versions") && newer(memory, path).is_none()
    };
    let needed = memory.files.iter().filter(|(path, _)| !path.ends_with(".json") && is_needed(path));
    needed.map(|(path, bytes)| (path.clone(), bytes.clone())).collect()
}

/// A manifest that is newer than one.
fn newer<'a>(memory: &'a Memory, path: &str) -> Option<&'a String> {
    let is_newer = |other: &&String| match path.len() > 30 {
        true => other.as_str() < path,
        false => other.as_str() > path,
    };
    memory.files.keys().filter(|other| other.ends_with(".manifest")).find(is_newer)
}

#[test]
fn damaged_tables_are_errors_or_values() {
    let (mut flips, mut cuts, mut others) = ([0; 2], [0; 2], [0; 2]);
    for name in TABLES.iter().chain(DELETED) {
        let mut memory = Memory::of(name);
        for (path, bytes) in files(&memory) {
            let start = metadata_start(&path, &bytes);
            for at in (start..bytes.len()).step_by(step(bytes.len() - start, 120)) {
                // Continued numbers, small and large ones, and single bits.
                for change in [0x80, 0xff, 1 << (at % 7)] {
                    let mut flipped = bytes.to_vec();
                    flipped[at] ^= change;
                    check(
                        &mut memory,
                        &path,
                        flipped,
                        &format!("{name}: byte {at} ^ {change:#x}"),
                        &mut flips,
                    );
                }
            }
            for end in (0..bytes.len()).step_by(step(bytes.len(), 40)) {
                check(&mut memory, &path, bytes[..end].to_vec(), &format!("{name}: cut at {end}"), &mut cuts);
            }
            // Values, and the sizes and positions among them.
            for at in (0..start).step_by(step(start, 120)) {
                for change in [0xff, 1 << (at % 8)] {
                    let mut flipped = bytes.to_vec();
                    flipped[at] ^= change;
                    check(
                        &mut memory,
                        &path,
                        flipped,
                        &format!("{name}: byte {at} ^ {change:#x}"),
                        &mut others,
                    );
                }
            }
        }
        assert!(read(&memory).is_ok(), "{name} is as it was");
    }
    eprintln!("[sound, errors] of flips {flips:?}, cuts {cuts:?}, values {others:?}");
    assert!(flips[1] > flips[0] / 2 && others[1] > 100);
    assert_eq!(cuts[0], 0, "cut tables are errors");
}
