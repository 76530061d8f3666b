//! The list of episodes of a folder of ours, `meta/episodes`: its files appear by renaming, and what they list exists.
//! Every episode has a table and videos of its own, so all that is to be known of one is its length.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use swm_core::{Column, Slice};
use swm_data::error::{At as _, DataError, Result, invalid, missing, wrong_type};
use swm_files::{read_regular, replace_unsynced};

use super::contents::video;
use super::info::INFO;
use super::manifest::{Manifest, OWN};
use super::parquet_file::{self, ColumnOut};
use super::table::{Table, is_no_column};
use super::tasks::TASK_INDEX;
use super::{last_row, tasks};

/// Files in a folder, as LeRobot divides them.
pub(super) const CHUNK: usize = 1000;
/// Episodes in a file of the list, which is written anew for each of them.
const PER_FILE: usize = 500;
/// The checksums of an episode's files: its table, then its videos in the order of the columns.
const CHECKSUMS: &str = "swm/crc32";
/// The checksum of the last row of an episode that is beside its table; -1: there is none.
const LAST_ROW: &str = "swm/last_row_crc32";

/// One episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    /// Those of its table.
    pub(super) rows: usize,
    pub(super) checksums: Vec<u32>,
    /// The checksum of its last row, where that is beside the table.
    pub(super) last_row: Option<u32>,
    /// Where the folder has a column of tasks: those of its rows.
    pub(super) tasks: Vec<String>,
}

/// `data/chunk-000/file-017.parquet`.
pub(super) fn data_path(episode: usize) -> String {
    format!("data/chunk-{:03}/file-{:03}.parquet", episode / CHUNK, episode % CHUNK)
}

/// `videos/observation.images.pixels/chunk-000/file-017.mp4`.
pub(super) fn video_path(camera: &str, episode: usize) -> String {
    format!("videos/{camera}/chunk-{:03}/file-{:03}.mp4", episode / CHUNK, episode % CHUNK)
}

/// The file of the list that names an episode.
pub(super) fn list_of(episode: usize) -> String {
    list_path(episode / PER_FILE)
}

fn list_path(file: usize) -> String {
    format!("meta/episodes/chunk-{:03}/file-{:03}.parquet", file / CHUNK, file % CHUNK)
}

/// All episodes that were committed, of which `meta/info.json` counts so many. It follows the list, so that a count above what is
/// listed means that a part of the list is gone.
pub(super) fn read_all(folder: &Path, manifest: &Manifest, counted: usize) -> Result<Vec<Entry>> {
    let entries = read(folder, manifest.cameras().count())?;
    match counted > entries.len() {
        true => Err(missing(format!(
            "`meta/episodes` lists {} of the {counted} episodes that `{INFO}` counts, as after an incomplete copy; copy `meta/episodes` \
             again, or list them again from their tables and videos by `swm verify` with `fix`",
            entries.len()
        ))),
        false => Ok(entries),
    }
}

/// The episodes behind those that are listed, up to `counted`, as their files have them. All of these must be whole.
pub(super) fn unlisted(
    folder: &Path,
    manifest: &Manifest,
    listed: usize,
    counted: usize,
) -> Result<Vec<Entry>> {
    let tasks = if manifest.has_tasks { tasks::of_ours(folder)? } else { BTreeMap::new() };
    let whole = |episode| -> Result<Entry> {
        let data = folder.join(data_path(episode));
        let table = Table::open(&data)?;
        for (name, _) in OWN {
            table.column(name).at(data.display())?;
        }
        let mut checksums = vec![crc32fast::hash(&read_regular(&data)?)];
        for (_, camera) in manifest.cameras() {
            let path = folder.join(video_path(&camera, episode));
            video(&path)?;
            checksums.push(crc32fast::hash(&read_regular(&path)?));
        }
        let last = folder.join(last_row::path_of(episode));
        let last_row = match manifest.drops_last_row && last.is_file() {
            true => Some(crc32fast::hash(&read_regular(&last)?)),
            false => None,
        };
        let mut own = Vec::new();
        if manifest.has_tasks {
            let of = |table: &Table| table.integers(TASK_INDEX)?.ok_or(missing("its rows have no tasks"));
            let mut numbers = of(&table).at(data.display())?;
            if last_row.is_some() {
                numbers.extend(of(&Table::open(&last)?).at(last.display())?);
            }
            own = tasks::named(&tasks, &numbers)?;
        }
        Ok(Entry { rows: table.rows(), checksums, last_row, tasks: own })
    };
    let place =
        |episode| format!("episode {episode}, which `meta/episodes` does not list, cannot be listed again");
    (listed..counted).map(|episode| whole(episode).at(place(episode))).collect()
}

/// The episodes that the list names.
pub(super) fn read(folder: &Path, videos: usize) -> Result<Vec<Entry>> {
    let mut entries = Vec::new();
    for file in 0.. {
        let path = folder.join(list_path(file));
        if !path.is_file() {
            break;
        }
        let table = Table::open(&path)?;
        let (Column::I64(rows), Column::I64(checksums)) = (table.column("length")?, table.column(CHECKSUMS)?)
        else {
            return Err(wrong_type("lengths or checksums are no numbers")).at(path.display());
        };
        if rows.len().checked_mul(videos + 1) != Some(checksums.len()) {
            return Err(invalid(format!(
                "{}: {} checksums of {} episodes",
                path.display(),
                checksums.len(),
                rows.len()
            )));
        }
        // A program that sorted the list in another way would give every episode the checksums of another.
        let numbers = table.integers("episode_index").at(path.display())?.unwrap_or_default();
        if let Some((expected, number)) =
            (entries.len() as i64..).zip(numbers).find(|(at, number)| at != number)
        {
            let reason = format!("it lists episode {number} where episode {expected} belongs");
            return Err(invalid(reason)).at(path.display());
        }
        let last_rows = table.integers(LAST_ROW).at(path.display())?;
        let tasks = match table.column("tasks") {
            Ok(Column::Str(tasks)) => tasks,
            Err(error) if !is_no_column(&error) => return Err(error).at(path.display()),
            _ => Vec::new(),
        };
        let per_episode = tasks.len() / rows.len().max(1);
        for (at, (&rows, checksums)) in rows.iter().zip(checksums.chunks_exact(videos + 1)).enumerate() {
            let rows = i32::try_from(rows).ok().filter(|&rows| rows > 0);
            let rows = rows.ok_or(invalid("an episode of no length")).at(path.display())?;
            let checksums = checksums.iter().map(|&checksum| checksum as u32).collect();
            let last_row = last_rows.as_ref().and_then(|rows| rows.get(at)).copied().unwrap_or(-1);
            let mut tasks: Vec<String> = tasks[at * per_episode..(at + 1) * per_episode].to_vec();
            tasks.dedup();
            let last_row = u32::try_from(last_row).ok();
            entries.push(Entry { rows: rows as usize, checksums, last_row, tasks });
        }
    }
    Ok(entries)
}

/// Commits the last of `entries`, which are all that there are: writes the file of the list that it is in.
pub(super) fn commit(folder: &Path, manifest: &Manifest, entries: &[Entry]) -> Result<(), DataError> {
    let file = entries.len().saturating_sub(1) / PER_FILE;
    let first = file * PER_FILE;
    let path = folder.join(list_path(file));
    let bytes = list(manifest, entries, first, file).map_err(|error| DataError::record(&path, error))?;
    let written = match path.parent() {
        Some(parent) => fs::create_dir_all(parent).and_then(|()| replace_unsynced(&path, &bytes)),
        None => replace_unsynced(&path, &bytes),
    };
    written.map_err(|source| DataError::io(&path, "write", source))
}

/// Commits all of `entries` behind the first `listed`: a file of the list at a time.
pub(super) fn commit_from(
    folder: &Path,
    manifest: &Manifest,
    entries: &[Entry],
    listed: usize,
) -> Result<(), DataError> {
    let ends_file = |count: &usize| count.is_multiple_of(PER_FILE) || *count == entries.len();
    (listed + 1..=entries.len())
        .filter(ends_file)
        .try_for_each(|count| commit(folder, manifest, &entries[..count]))
}

/// The bytes of a file of the list.
fn list(manifest: &Manifest, entries: &[Entry], first: usize, file: usize) -> Result<Vec<u8>> {
    let before: usize = entries[..first].iter().map(|entry| entry.rows).sum();
    let entries = &entries[first..];
    let numbers = |value: &dyn Fn(usize) -> usize| -> Vec<i64> {
        (first..first + entries.len()).map(|episode| value(episode) as i64).collect()
    };
    let lengths: Vec<i64> = entries.iter().map(|entry| entry.rows as i64).collect();
    let ends: Vec<i64> = lengths
        .iter()
        .scan(before as i64, |end, rows| {
            *end += rows;
            Some(*end)
        })
        .collect();
    let starts: Vec<i64> = ends.iter().zip(&lengths).map(|(end, rows)| end - rows).collect();
    let (indices, chunks, files) = (
        numbers(&|episode| episode),
        numbers(&|episode| episode / CHUNK),
        numbers(&|episode| episode % CHUNK),
    );
    let (list_chunks, list_files) = (numbers(&|_| file / CHUNK), numbers(&|_| file % CHUNK));
    // Lists of one length for all: those of fewer tasks end in their last one, again.
    let most = entries.iter().map(|entry| entry.tasks.len()).max().unwrap_or(0).max(1);
    let mut tasks = Vec::with_capacity(most * entries.len());
    for entry in entries {
        let own = if manifest.has_tasks { &*entry.tasks } else { &[] };
        let last = own.last().map_or(env(manifest), String::as_str);
        tasks.extend((0..most).map(|at| own.get(at).map_or(last, String::as_str).to_owned()));
    }
    let last_rows: Vec<i64> = entries.iter().map(|entry| entry.last_row.map_or(-1, i64::from)).collect();
    let (from, to): (Vec<f64>, Vec<f64>) =
        lengths.iter().map(|&rows| (0.0, rows as f64 / manifest.frames_per_second)).unzip();
    let checksums: Vec<i64> = entries
        .iter()
        .flat_map(|entry| entry.checksums.iter().map(|&checksum| i64::from(checksum)))
        .collect();
    let videos = manifest.cameras().count();
    let mut columns = vec![
        ColumnOut::scalar("episode_index", Slice::I64(&indices)),
        ColumnOut { name: "tasks".to_owned(), values: Slice::Str(&tasks), list: Some(most) },
        ColumnOut::scalar("length", Slice::I64(&lengths)),
        ColumnOut::scalar("data/chunk_index", Slice::I64(&chunks)),
        ColumnOut::scalar("data/file_index", Slice::I64(&files)),
        ColumnOut::scalar("dataset_from_index", Slice::I64(&starts)),
        ColumnOut::scalar("dataset_to_index", Slice::I64(&ends)),
    ];
    for (_, camera) in manifest.cameras() {
        columns.push(ColumnOut::scalar(format!("videos/{camera}/chunk_index"), Slice::I64(&chunks)));
        columns.push(ColumnOut::scalar(format!("videos/{camera}/file_index"), Slice::I64(&files)));
        columns.push(ColumnOut::scalar(format!("videos/{camera}/from_timestamp"), Slice::F64(&from)));
        columns.push(ColumnOut::scalar(format!("videos/{camera}/to_timestamp"), Slice::F64(&to)));
    }
    columns.push(ColumnOut::scalar("meta/episodes/chunk_index", Slice::I64(&list_chunks)));
    columns.push(ColumnOut::scalar("meta/episodes/file_index", Slice::I64(&list_files)));
    columns.push(ColumnOut {
        name: CHECKSUMS.to_owned(),
        values: Slice::I64(&checksums),
        list: Some(videos + 1),
    });
    if manifest.drops_last_row {
        columns.push(ColumnOut::scalar(LAST_ROW, Slice::I64(&last_rows)));
    }
    parquet_file::bytes(&columns, &[])
}

/// The environment: what is done in the episodes, where no column says it.
pub(super) fn env(manifest: &Manifest) -> &str {
    manifest.runs.first().map_or("unknown", |(_, metadata)| metadata.env.as_str())
}
