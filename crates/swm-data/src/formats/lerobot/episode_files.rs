//! Where the episodes of a folder lie: which table and which rows of it, which videos and which frames. Version 2 has a table and a
//! video per episode, version 3 puts several into one; nothing is read here but lists.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::Column;

use super::info::Info;
use super::table::Table;
use crate::error::{At as _, FormatError, Result, invalid, missing, wrong_type};
use crate::formats::disk::read_regular;

/// Above this size a line-by-line list of episodes is taken for damage.
const MAX_LIST: u64 = 1 << 30;

/// Where an episode lies.
#[derive(Debug, Default)]
pub(super) struct EpisodeFiles {
    /// As the list and the tables number it.
    pub(super) number: i64,
    /// Rows of its table.
    pub(super) rows: usize,
    /// A table of one more row, behind these, in folders of ours.
    pub(super) last_row: Option<PathBuf>,
    /// The table that the list names; see `rows` for the one that holds it.
    pub(super) data: PathBuf,
    /// Its first row in that table.
    pub(super) first: usize,
    /// Its first row in the dataset, where the list says it.
    pub(super) start: Option<usize>,
    /// By camera: the video, and the time in seconds at which the episode begins there; in folders of ours none, as there row n is frame n.
    pub(super) videos: BTreeMap<String, (PathBuf, Option<f64>)>,
    /// The text of its task, where it has one task.
    pub(super) task: Option<String>,
    /// By file, in folders of ours.
    pub(super) checksums: BTreeMap<PathBuf, u32>,
}

/// A length that an episode can have.
fn bounded(rows: usize) -> Result<usize> {
    match i32::try_from(rows) {
        Ok(_) => Ok(rows),
        Err(_) => Err(invalid(format!("an episode of {rows} rows"))),
    }
}

/// Version 2: a table and a video per episode, and a list of lengths.
pub(super) fn second(path: &Path, info: &Info, cameras: &[String]) -> Result<Vec<EpisodeFiles>> {
    let list = path.join("meta/episodes.jsonl");
    if fs::metadata(&list).at(list.display())?.len() > MAX_LIST {
        return Err(invalid("its list of episodes is too long"));
    }
    let text = String::from_utf8(read_regular(&list).at(list.display())?).map_err(FormatError::other)?;
    let mut episodes = Vec::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let entry: Json = serde_json::from_str(line).at(list.display())?;
        let number = |key: &str| entry[key].as_u64().and_then(|value| usize::try_from(value).ok());
        let (Some(episode), Some(rows)) = (number("episode_index"), number("length")) else {
            return Err(missing("an episode without index or length")).at(list.display());
        };
        let rows = bounded(rows)?;
        let numbers = [("episode_chunk", episode / info.chunks_size), ("episode_index", episode)];
        let data = info.data(path, &numbers)?;
        let task = match entry["tasks"].as_array().map(Vec::as_slice) {
            Some([Json::String(task)]) => Some(task.clone()),
            _ => None,
        };
        let mut found = EpisodeFiles { number: episode as i64, rows, data, task, ..EpisodeFiles::default() };
        for camera in cameras {
            found.videos.insert(camera.clone(), (info.video(path, camera, &numbers)?, Some(0.0)));
        }
        episodes.push(found);
    }
    Ok(episodes)
}

/// Version 3: tables that say in which file each episode lies, and where.
pub(super) fn third(path: &Path, info: &Info, cameras: &[String]) -> Result<Vec<EpisodeFiles>> {
    let mut episodes: Vec<EpisodeFiles> = Vec::new();
    // Rows of a table are counted over all tables: the first of its episodes tells where it begins.
    let mut begins: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for chunk in 0.. {
        let folder = path.join(format!("meta/episodes/chunk-{chunk:03}"));
        if !folder.is_dir() {
            break;
        }
        for file in 0.. {
            let list = folder.join(format!("file-{file:03}.parquet"));
            if !list.is_file() {
                break;
            }
            let table = Table::open(&list)?;
            let integers = |name: &str| match table.column(name)? {
                Column::I64(values) if values.len() == table.rows() => Ok(values),
                other => Err(wrong_type(format!("column `{name}` holds {} {}", other.len(), other.dtype()))),
            };
            let (lengths, starts) = (integers("length")?, integers("dataset_from_index")?);
            let numbers_of = table.integers("episode_index");
            // As many texts as episodes are one for each.
            let tasks = match table.column("tasks") {
                Ok(Column::Str(tasks)) if tasks.len() == table.rows() => tasks,
                _ => Vec::new(),
            };
            let (chunks, files) = (integers("data/chunk_index")?, integers("data/file_index")?);
            let size = |value: i64| {
                usize::try_from(value).map_err(|_| invalid(format!("the number {value} is negative")))
            };
            let mut videos = Vec::new();
            for camera in cameras {
                let key = |what: &str| format!("videos/{camera}/{what}");
                let Column::F64(times) = table.column(&key("from_timestamp"))? else {
                    return Err(wrong_type(format!("column `{}` holds no times", key("from_timestamp"))));
                };
                videos.push((camera, integers(&key("chunk_index"))?, integers(&key("file_index"))?, times));
            }
            for row in 0..table.rows() {
                let numbers = [("chunk_index", size(chunks[row])?), ("file_index", size(files[row])?)];
                let data = info.data(path, &numbers)?;
                let start = size(starts[row])?;
                let begin = begins.entry(data.clone()).or_insert(start);
                *begin = start.min(*begin);
                let mut found = EpisodeFiles {
                    number: numbers_of.as_ref().map_or(episodes.len() as i64, |numbers| numbers[row]),
                    rows: bounded(size(lengths[row])?)?,
                    data,
                    start: Some(start),
                    task: tasks.get(row).cloned(),
                    ..EpisodeFiles::default()
                };
                for (camera, chunks, files, times) in &videos {
                    let numbers = [("chunk_index", size(chunks[row])?), ("file_index", size(files[row])?)];
                    let video = info.video(path, camera, &numbers)?;
                    let time = times.get(row).copied().unwrap_or(f64::NAN);
                    if !(0.0..1e9).contains(&time) {
                        return Err(invalid(format!("a video begins at {time} s")));
                    }
                    found.videos.insert((*camera).clone(), (video, Some(time)));
                }
                episodes.push(found);
            }
        }
    }
    for files in &mut episodes {
        files.first = files.start.unwrap_or_default() - begins.get(&files.data).copied().unwrap_or_default();
    }
    match episodes.len() == info.total_episodes {
        true => Ok(episodes),
        false => Err(missing(format!("{} of {} episodes are listed", episodes.len(), info.total_episodes))),
    }
}
