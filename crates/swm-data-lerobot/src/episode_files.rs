//! Where the episodes of a folder lie: which table and which rows of it, which videos and which frames. Version 2 has a table and a
//! video per episode, version 3 puts several into one; nothing is read here but lists.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::Column;
use swm_data::error::{At as _, FormatError, Result, invalid, missing, wrong_type};
use swm_files::read_regular;

use super::info::Info;
use super::table::Table;

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
    in_order(episodes)
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
            let integers = |name: &str| match table.column(name).at(list.display())? {
                Column::I64(values) if values.len() == table.rows() => Ok(values),
                other => Err(wrong_type(format!("column `{name}` holds {} {}", other.len(), other.dtype()))),
            };
            let (lengths, starts) = (integers("length")?, integers("dataset_from_index")?);
            let numbers_of = table.integers("episode_index").at(list.display())?;
            // As many texts as episodes are one for each.
            let tasks = table.texts("tasks").at(list.display())?.unwrap_or_default();
            let (chunks, files) = (integers("data/chunk_index")?, integers("data/file_index")?);
            let size = |value: i64| {
                usize::try_from(value).map_err(|_| invalid(format!("the number {value} is negative")))
            };
            let mut videos = Vec::new();
            for camera in cameras {
                let key = |what: &str| format!("videos/{camera}/{what}");
                let Column::F64(times) = table.column(&key("from_timestamp")).at(list.display())? else {
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
    let episodes = in_order(episodes)?;
    match episodes.len() == info.total_episodes {
        true => Ok(episodes),
        false => Err(missing(format!("{} of {} episodes are listed", episodes.len(), info.total_episodes))),
    }
}

/// Episodes by their numbers, whatever the order of the list. One that was taken out leaves a gap; none is there twice.
fn in_order(mut episodes: Vec<EpisodeFiles>) -> Result<Vec<EpisodeFiles>> {
    episodes.sort_by_key(|files| files.number);
    if let Some(EpisodeFiles { number, .. }) = episodes.first().filter(|first| first.number < 0) {
        return Err(invalid(format!("the list of episodes names episode {number}")));
    }
    match episodes.windows(2).find(|pair| pair[0].number == pair[1].number) {
        Some(pair) => Err(invalid(format!("episode {} is listed twice", pair[0].number))),
        None => Ok(episodes),
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use swm_core::{Batch, BoxError, Registry};
    use swm_data::testing::{assert_same, contents_in, record_in};
    use swm_data::{DataError, Dataset, WriteMode, open_in};

    use super::*;
    use crate::FORMATS;
    use crate::info::INFO;
    use crate::parquet_file::{self, ColumnOut};

    fn registry() -> Registry {
        Registry::new().with(FORMATS)
    }

    fn open(path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        open_in(&registry(), path)
    }

    fn record(path: &Path, mode: WriteMode, episodes: Range<usize>) -> Result<u64, BoxError> {
        record_in(&registry(), path, mode, episodes)
    }

    fn contents(path: &Path) -> Vec<Batch> {
        contents_in(&registry(), path)
    }

    /// A column with these of its rows.
    fn picked(column: &Column, width: usize, rows: &[usize]) -> Column {
        let mut out: Option<Column> = None;
        for &row in rows {
            let part = column.as_slice().range(row * width, width).to_column();
            match &mut out {
                None => out = Some(part),
                Some(out) => assert!(out.extend(part.as_slice())),
            }
        }
        out.unwrap()
    }

    /// Writes the lists of a folder anew, with these rows of the one that it had in each file.
    fn list_anew(folder: &Path, list: &Table, names: &[String], files: &[&[usize]]) {
        for (file, rows) in files.iter().enumerate() {
            let columns: Vec<(String, usize, Column)> = names
                .iter()
                .map(|name| {
                    let column = list.column(name).unwrap();
                    let width = column.len() / list.rows();
                    (name.clone(), width, picked(&column, width, rows))
                })
                .collect();
            let out = columns.iter().map(|(name, width, column)| ColumnOut {
                name: name.clone(),
                values: column.as_slice(),
                list: (name == "tasks").then_some(*width),
            });
            let bytes = parquet_file::bytes(&out.collect::<Vec<_>>(), &[]).unwrap();
            fs::write(folder.join(format!("meta/episodes/chunk-000/file-{file:03}.parquet")), bytes).unwrap();
        }
    }

    #[test]
    fn the_order_of_a_list_is_that_of_its_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.lerobot");
        record(&path, WriteMode::Error, 0..4).unwrap();
        // As another program leaves it that rewrites a folder of ours.
        fs::remove_file(path.join("meta/swm.json")).unwrap();
        let expected: Vec<Batch> = contents(&path);
        let file = path.join("meta/episodes/chunk-000/file-000.parquet");
        let kept = folder.path().join("list.parquet");
        fs::rename(&file, &kept).unwrap();
        let list = Table::open(&kept).unwrap();
        let camera = |what: &str| format!("videos/observation.images.pixels/{what}");
        let mut names: Vec<String> =
            ["episode_index", "tasks", "length", "dataset_from_index", "data/chunk_index", "data/file_index"]
                .map(str::to_owned)
                .to_vec();
        names.extend(["chunk_index", "file_index", "from_timestamp"].map(camera));
        names.extend(
            ["chunk_index", "file_index", "from_timestamp"]
                .map(|what| camera(what).replace("pixels", "goal")),
        );
        let orders: [&[&[usize]]; 3] = [&[&[3, 1, 0, 2]], &[&[2, 0], &[3, 1]], &[&[3], &[2], &[0, 1]]];
        for files in orders {
            list_anew(&path, &list, &names, files);
            let found = contents(&path);
            assert_eq!(found.len(), 4, "{files:?}");
            found.iter().zip(&expected).for_each(|(found, expected)| assert_same(found, expected));
        }
        for file in 1..3 {
            fs::remove_file(path.join(format!("meta/episodes/chunk-000/file-{file:03}.parquet"))).unwrap();
        }
        let wrong: [(&[usize], &str); 3] = [
            (&[0, 2, 1, 2], "episode 2 is listed twice"),
            (&[3, 1, 0], "3 of 4 episodes are listed"),
            (&[0, 1, 2], "3 of 4 episodes are listed"),
        ];
        for (rows, part) in wrong {
            list_anew(&path, &list, &names, &[rows]);
            let message = open(&path).err().unwrap().to_string();
            assert!(message.contains(part), "{rows:?}: {message}");
        }
    }

    /// Of version 2, the list is a text.
    #[test]
    fn so_is_that_of_lines() {
        let entry =
            |episode: usize| format!("{{\"episode_index\": {episode}, \"length\": {}}}\n", 10 + episode);
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("meta")).unwrap();
        let info = r#"{"codebase_version": "v2.1", "fps": 10, "total_episodes": 3, "features": {},
            "data_path": "data/{episode_index}.parquet"}"#;
        fs::write(folder.path().join(INFO), info).unwrap();
        let info = Info::read(folder.path()).unwrap();
        let list = |episodes: &[usize]| {
            let lines: String = episodes.iter().copied().map(entry).collect();
            fs::write(folder.path().join("meta/episodes.jsonl"), lines).unwrap();
            second(folder.path(), &info, &[])
        };
        let lengths: Vec<usize> = list(&[2, 0, 1]).unwrap().iter().map(|files| files.rows).collect();
        assert_eq!(lengths, [10, 11, 12]);
        let message = |episodes: &[usize]| list(episodes).unwrap_err().to_string();
        assert!(message(&[0, 1, 0]).contains("episode 0 is listed twice"));
        // Without an episode that was taken out.
        let lengths: Vec<usize> = list(&[2, 0]).unwrap().iter().map(|files| files.rows).collect();
        assert_eq!(lengths, [10, 12]);
    }

    /// The shape of a column is that of the lists in the first table; those of another one may differ.
    #[test]
    fn lists_of_another_length_move_no_rows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.lerobot");
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets/lerobot_v2.1");
        let table = |episode: usize| format!("data/chunk-000/episode_00000{episode}.parquet");
        let video = |episode| format!("videos/chunk-000/observation.images.top/episode_00000{episode}.mp4");
        let lists = ["meta/info.json", "meta/episodes.jsonl", "meta/tasks.jsonl"].map(str::to_owned);
        for file in lists.into_iter().chain([table(0), table(1), video(0), video(1)]) {
            fs::create_dir_all(path.join(&file).parent().unwrap()).unwrap();
            fs::copy(golden.join(&file), path.join(&file)).unwrap();
        }
        let second = path.join(table(1));
        let table = Table::open(&second).unwrap();
        let names: Vec<String> = table.leaves().into_iter().map(|(name, _)| name).collect();
        let mut columns: Vec<Column> = names.iter().map(|name| table.column(name).unwrap()).collect();
        let mut widths: Vec<usize> = columns.iter().map(|column| column.len() / table.rows()).collect();
        let wide = widths.iter().position(|width| *width > 1).unwrap();
        widths[wide] += 1;
        let longer: Vec<usize> =
            (0..table.rows() * widths[wide]).map(|at| at % columns[wide].len()).collect();
        columns[wide] = picked(&columns[wide], 1, &longer);
        let out = names.iter().zip(&columns).zip(&widths).map(|((name, column), &width)| ColumnOut {
            name: name.clone(),
            values: column.as_slice(),
            list: (width > 1).then_some(width),
        });
        fs::write(&second, parquet_file::bytes(&out.collect::<Vec<_>>(), &[]).unwrap()).unwrap();
        let mut dataset = open(&path).unwrap();
        let read = |dataset: &mut Box<dyn Dataset>, episode| {
            let mut batch = Batch::new(dataset.schema().clone(), 0);
            let rows = 0..dataset.episode_len(episode);
            dataset.read(episode, rows, &mut batch).map_err(|error| error.to_string())
        };
        read(&mut dataset, 0).unwrap();
        let message = read(&mut dataset, 1).unwrap_err();
        assert!(message.contains("episode_000001.parquet has ") && message.contains("in each"), "{message}");
    }
}
