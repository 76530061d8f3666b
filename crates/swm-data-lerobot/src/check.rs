//! Whether the descriptions of a folder agree with its tables: `meta/info.json` (`fps`, features and their shapes, totals), the list
//! of tasks, and the list of episodes. Readers rely on them: LeRobot's finds frames by `fps`, and texts of tasks by their numbers.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::Column;
use swm_data::error::{Result, invalid};
use swm_data::tools::compatibility;

use super::contents::{Shared, shape_of, video};
use super::episode_files::EpisodeFiles;
use super::info::{INFO, Info, Version, features};
use super::manifest::Manifest;
use super::rows::{Labels, Place};
use super::table::Table;
use super::tasks;

/// Disagreements are listed up to this number.
const MAX_LISTED: usize = 8;
/// Types of features whose values stand in the tables.
const IN_TABLES: [&str; 14] = [
    "float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32",
    "uint64", "bool", "string", "image",
];

/// Compares the descriptions of the folder at `path` with what it holds.
///
/// # Errors
///
/// The disagreements, each with the file, the field and both values.
pub(super) fn check(path: &Path, shared: &Shared) -> Result<()> {
    let info = Info::read(path)?;
    let mut found = Found { path, wrong: Vec::new() };
    found.totals(&info, shared, Manifest::read(path)?.is_some());
    found.features(&info, shared)?;
    found.tables(&info, shared)?;
    found.rows(shared);
    let count = found.wrong.len();
    if count > MAX_LISTED {
        found.wrong.truncate(MAX_LISTED);
        found.wrong.push(format!("and {} more", count - MAX_LISTED));
    }
    match count {
        0 => Ok(()),
        _ => Err(invalid(found.wrong.join("; "))),
    }
}

/// The disagreements of a folder.
struct Found<'a> {
    path: &'a Path,
    wrong: Vec<String>,
}

impl Found<'_> {
    /// A field of `meta/info.json`, its value, and what there is.
    fn field(&mut self, field: impl Display, says: impl Display, there: impl Display) {
        self.wrong.push(format!("`{INFO}`: `{field}` is {says}, and {there}"));
    }

    /// A file of the folder, as messages name it.
    fn name(&self, file: &Path) -> String {
        file.strip_prefix(self.path).unwrap_or(file).display().to_string()
    }

    fn totals(&mut self, info: &Info, shared: &Shared, is_ours: bool) {
        let listed = shared.episodes.len();
        // The count of a recording that was interrupted follows later; `swm verify --fix` sets it.
        if is_ours && info.total_episodes < listed {
            return;
        }
        if info.total_episodes != listed {
            self.field("total_episodes", info.total_episodes, format!("{listed} are listed"));
        }
        let rows: usize = shared.episodes.iter().map(|files| files.rows).sum();
        if let Some(frames) = info.total_frames.as_u64().filter(|&frames| frames != rows as u64) {
            self.field("total_frames", frames, format!("the listed episodes have {rows}"));
        }
    }

    fn features(&mut self, info: &Info, shared: &Shared) -> Result<()> {
        if let Some(manifest) = Manifest::read(self.path)? {
            if manifest.frames_per_second != info.fps {
                let own = manifest.frames_per_second;
                self.field("fps", info.fps, format!("`meta/swm.json` has {own} frames per second"));
            }
            for (name, own) in features(&manifest) {
                match info.features.get(&name) {
                    None => self.field(
                        "features",
                        format_args!("without `{name}`"),
                        "`meta/swm.json` has that column",
                    ),
                    Some(feature) if feature["shape"] != own["shape"] => {
                        self.shape(&name, &feature["shape"], format!("the column is {}", own["shape"]));
                    }
                    Some(_) => {}
                }
            }
        }
        let Some(first) = shared.episodes.first() else { return Ok(()) };
        for (name, feature) in &info.features {
            let Some((file, _)) = first.videos.get(name).filter(|_| feature["dtype"] == "video") else {
                continue;
            };
            // One that cannot be opened is told where it is read.
            let Ok(size) = video(file).map(|video| video.size()) else { continue };
            let sorted = |mut sizes: Vec<usize>| {
                sizes.sort_unstable();
                sizes
            };
            let Ok(shape) = shape_of(feature) else { continue };
            // Channels may come first.
            if sorted(shape) != sorted(vec![size.0, size.1, 3]) {
                let there = format!("{} has frames of {} x {} pixels", self.name(file), size.0, size.1);
                self.shape(name, &feature["shape"], there);
            }
        }
        Ok(())
    }

    fn shape(&mut self, name: &str, says: &Json, there: impl Display) {
        self.field(format_args!("features.{name}.shape"), says, there);
    }

    /// What every table holds, table by table.
    fn tables(&mut self, info: &Info, shared: &Shared) -> Result<()> {
        let tasks = Tasks::read(self.path, info.version()?)?;
        // That of a recording that was interrupted follows later.
        let is_ours = Manifest::read(self.path)?.is_some();
        if let (Some(tasks), Some(total)) = (&tasks.numbers, info.total_tasks.as_u64())
            && tasks.len() as u64 != total
            && !(is_ours && tasks.len() as u64 > total)
        {
            self.field(
                "total_tasks",
                total,
                format!("`{}` has {}", tasks::file(info.version()?), tasks.len()),
            );
        }
        let mut by_table: BTreeMap<&Path, Vec<(usize, usize)>> = BTreeMap::new();
        for (episode, files) in shared.episodes.iter().enumerate() {
            // One that has no place is told where it is read.
            if let Ok(Place { data, first }) = shared.places.of(&shared.episodes, episode) {
                by_table.entry(data).or_default().push((*first, files.rows));
            }
        }
        let (mut told, mut is_rate_told) = (BTreeSet::new(), false);
        for (file, episodes) in by_table {
            // One that cannot be opened is told where it is read.
            let Ok(table) = Table::open(file) else { continue };
            for (name, feature) in &info.features {
                let is_in_tables = feature["dtype"].as_str().is_some_and(|dtype| IN_TABLES.contains(&dtype));
                if is_in_tables
                    && !told.contains(name)
                    && let Some(wrong) = self.feature(&table, file, name, feature)
                {
                    told.insert(name.clone());
                    self.wrong.push(wrong);
                }
            }
            if let Ok(Column::F32(times)) = table.column("timestamp")
                && !is_rate_told
                && let Some(rate) = episodes.iter().find_map(|&episode| other_rate(&times, episode, info.fps))
            {
                is_rate_told = true;
                let fix = match compatibility::is_rate(rate) {
                    true => format!("; a copy with `fps` {} repairs it", compatibility::rate_text(rate)),
                    false => String::new(),
                };
                let file = self.name(file);
                let there = format!("the timestamps of {file} are those of {rate:.4} rows per second{fix}");
                self.field("fps", info.fps, there);
            }
            if let Ok(Column::I64(numbers)) = table.column("task_index")
                && let Some(wrong) = tasks.misfit(&numbers)
            {
                self.wrong.push(format!("{}: {wrong}", self.name(file)));
            }
        }
        Ok(())
    }

    /// The labels of rows in tables (`episode_index` and the like), episode by episode.
    fn rows(&mut self, shared: &Shared) {
        let mut by_table: BTreeMap<&Path, Vec<(&EpisodeFiles, usize)>> = BTreeMap::new();
        for (episode, files) in shared.episodes.iter().enumerate() {
            let Ok(Place { data, first }) = shared.places.of(&shared.episodes, episode) else { continue };
            let (number, listed) = (files.number, (&files.data, files.first));
            if listed != (data, *first) {
                let [said, there] = [&files.data, data].map(|file| self.name(file));
                let rows = files.first;
                self.wrong.push(format!(
                    "the list of episodes places episode {number} in {said} from row {rows} on, and its rows are in {there} from row \
                     {first} on, where they are read"
                ));
            }
            by_table.entry(data).or_default().push((files, *first));
        }
        for (file, episodes) in by_table {
            // One that cannot be opened is told where it is read.
            let Ok(table) = Table::open(file) else { continue };
            // Nor is a column of it that cannot be decoded.
            let (Ok(labels), place) = (Labels::of(&table), self.name(file)) else { continue };
            for (files, first) in episodes {
                for (name, labels, begin) in
                    [("frame_index", &labels.frames, Some(0)), ("index", &labels.indices, files.start)]
                {
                    let own = labels.as_ref().and_then(|all| all.get(first..first + files.rows));
                    let (Some(own), Some(begin)) = (own, begin) else { continue };
                    if let Some(at) = (0..own.len()).find(|&at| own[at] != (begin + at) as i64) {
                        let (number, row, found) = (files.number, first + at, own[at]);
                        self.wrong.push(format!(
                            "{place}: `{name}` is {found} in row {row}, which is number {} of episode {number}",
                            begin + at
                        ));
                    }
                }
            }
        }
    }

    /// What is wrong with a feature in a table.
    fn feature(&self, table: &Table, file: &Path, name: &str, feature: &Json) -> Option<String> {
        let place = self.name(file);
        if !table.has(name) {
            return Some(format!("`{INFO}`: the feature `{name}` is listed, and {place} has no such column"));
        }
        if feature["dtype"] == "image" {
            return None;
        }
        // What cannot be read is told where it is read.
        let Ok(values) = table.column(name) else { return None };
        let Ok(shape) = shape_of(feature) else { return None };
        let dim: usize = shape.iter().product();
        let is_whole = table.rows().checked_mul(dim) == Some(values.len());
        (!is_whole).then(|| {
            let (shape, rows) = (&feature["shape"], table.rows());
            format!(
                "`{INFO}`: `features.{name}.shape` is {shape}, which is {dim} values a row, and {place} has {} values in {rows} rows",
                values.len()
            )
        })
    }
}

/// The rate of an episode's timestamps, if it is not `fps`.
fn other_rate(times: &[f32], (first, rows): (usize, usize), fps: f64) -> Option<f64> {
    let times = times.get(first..first.checked_add(rows)?)?;
    let [begin, .., end] = times else { return None };
    compatibility::other_rate(compatibility::rate(rows, *begin, *end), fps, rows)
}

/// The list of tasks.
struct Tasks {
    version: Version,
    /// `None`: there is no list.
    numbers: Option<BTreeSet<i64>>,
}

impl Tasks {
    fn read(folder: &Path, version: Version) -> Result<Self> {
        if !folder.join(tasks::file(version)).exists() {
            return Ok(Self { version, numbers: None });
        }
        let numbers = tasks::read(folder, version)?.into_keys().collect();
        Ok(Self { version, numbers: Some(numbers) })
    }

    /// What of a table's column `task_index` the list does not have.
    fn misfit(&self, numbers: &[i64]) -> Option<String> {
        let name = tasks::file(self.version);
        let Some(known) = &self.numbers else {
            let first = numbers.first()?;
            return Some(format!("`task_index` is {first}, and `{name}` is not there"));
        };
        let row = numbers.iter().position(|number| !known.contains(number))?;
        let listed: Vec<String> = known.iter().take(MAX_LISTED).map(i64::to_string).collect();
        let more = if known.len() > MAX_LISTED { ", …" } else { "" };
        Some(format!(
            "`task_index` is {} in row {row}, and `{name}` has the tasks {}{more}",
            numbers[row],
            if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
        ))
    }
}
