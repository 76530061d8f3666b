//! Opening a LeRobot folder and reading rows of it.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::error::BoxError;
use swm_core::{Batch, Column, Dtype, EpisodeSource, Field, Metadata, Schema, SliceMut};
use swm_media::mp4::Mp4Reader;

use super::episodes;
use super::info::{Info, Version};
use super::manifest::{Manifest, is_film};
use super::table::Table;
use crate::dataset::{Dataset, Steps, check_request, copy_rows, locate, read_rows};
use crate::error::DataError;

/// Above this size a line-by-line list of episodes is taken for damage.
const MAX_LIST: u64 = 1 << 30;

/// An open folder.
pub(super) struct LeRobotDataset {
    shared: Arc<Shared>,
    /// The columns of the table that was read last.
    table: Option<(PathBuf, BTreeMap<String, Column>)>,
    films: BTreeMap<usize, (PathBuf, Mp4Reader<BufReader<File>>)>,
}

struct Shared {
    path: PathBuf,
    schema: Arc<Schema>,
    columns: Vec<Source>,
    episodes: Vec<Place>,
    skipped: Vec<(String, String)>,
    /// Of folders of ours.
    runs: Vec<(u64, Metadata)>,
}

enum Source {
    /// A column of the tables.
    Table(String),
    /// A camera.
    Film(String),
    /// The episode's number, the row's number.
    Episode,
    Step,
}

/// Where an episode lies.
#[derive(Debug, Default)]
struct Place {
    rows: usize,
    data: PathBuf,
    /// Its first row in the table.
    first: usize,
    /// By camera: the film, and its first frame there.
    films: BTreeMap<String, (PathBuf, usize)>,
    /// By file, in folders of ours.
    checksums: BTreeMap<PathBuf, u32>,
}

impl LeRobotDataset {
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        let shared = Shared::open(path).map_err(|reason| DataError::damaged(path, reason))?;
        Ok(Self { shared: Arc::new(shared), table: None, films: BTreeMap::new() })
    }

    fn table_rows(
        &mut self,
        name: &str,
        episode: usize,
        width: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), String> {
        let shared = self.shared.clone();
        let place = &shared.episodes[episode];
        if self.table.as_ref().is_none_or(|(path, _)| *path != place.data) {
            self.table = Some((place.data.clone(), BTreeMap::new()));
        }
        let Some((path, columns)) = &mut self.table else { return Ok(()) };
        if !columns.contains_key(name) {
            let column = match (Table::open(path)?.column(name)?, out.dtype()) {
                (Column::I32(values), Dtype::U8) => {
                    Column::U8(values.into_iter().map(|value| value as u8).collect())
                }
                (column, _) => column,
            };
            columns.insert(name.to_owned(), column);
        }
        let values = columns[name].as_slice();
        let (start, size) = (place.first.checked_mul(width), place.rows.checked_mul(width));
        let fits = start
            .zip(size)
            .and_then(|(start, size)| start.checked_add(size))
            .is_some_and(|end| end <= values.len());
        if !fits || values.dtype() != out.dtype() {
            return Err(format!(
                "{} does not hold rows {} to {}",
                path.display(),
                place.first,
                place.first.saturating_add(place.rows)
            ));
        }
        copy_rows(values.range(place.first * width, place.rows * width), width, steps, out);
        Ok(())
    }

    fn film_rows(
        &mut self,
        column: usize,
        camera: &str,
        episode: usize,
        steps: Steps,
        out: &mut [u8],
    ) -> Result<(), String> {
        let shared = self.shared.clone();
        let (path, first) = shared.episodes[episode].films.get(camera).ok_or("there is no film")?;
        if self.films.get(&column).is_none_or(|(open, _)| open != path) {
            // The decoder of damaged films is the least robust part of all.
            check(path, &shared.episodes[episode])?;
            self.films.insert(column, (path.clone(), film(path)?));
        }
        let Some((_, film)) = self.films.get_mut(&column) else { return Ok(()) };
        let (height, width) = film.size();
        if shared.schema.fields()[column].shape != [height, width, 3] {
            return Err(format!("{}: it has pictures of {height} x {width}", path.display()));
        }
        let first = first.checked_add(steps.first).ok_or("it begins nowhere")?;
        film.read(first, steps.stride, out).map_err(|error| format!("{}: {error}", path.display()))
    }
}

impl Shared {
    fn open(path: &Path) -> Result<Self, String> {
        let info = Info::read(path)?;
        if let Some(manifest) = Manifest::read(path)? {
            return Self::ours(path, manifest);
        }
        let cameras: Vec<String> = info
            .features
            .iter()
            .filter(|(_, feature)| feature["dtype"] == "video")
            .map(|(name, _)| name.clone())
            .collect();
        let episodes = match info.version()? {
            Version::V2 => second(path, &info, &cameras)?,
            Version::V3 => third(path, &info, &cameras)?,
        };
        let (mut fields, mut columns, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
        let Some(first) = episodes.first() else { return Err("it holds no episode".to_owned()) };
        let table = Table::open(&first.data)?;
        let mut add = |name: &str, dtype, shape: &[usize], source| {
            fields.push(Field::step(name, dtype, shape));
            columns.push(source);
        };
        for (name, feature) in &info.features {
            if cameras.contains(name) {
                let known = if *name == cameras[0] { "pixels" } else { name };
                let size = first.films.get(name).ok_or("there is no film".to_owned());
                match size.and_then(|(path, _)| film(path)).map(|film| film.size()) {
                    Ok((height, width)) => {
                        add(known, Dtype::U8, &[height, width, 3], Source::Film(name.clone()));
                    }
                    Err(reason) => skipped.push((name.clone(), reason)),
                }
                continue;
            }
            let found = table.column(name).and_then(|values| {
                let width = shape_of(feature)?.iter().product::<usize>();
                match table.rows().checked_mul(width) == Some(values.len()) {
                    true => Ok(values.dtype()),
                    false => Err(format!("{} values in {} rows", values.len(), table.rows())),
                }
            });
            match found {
                Ok(_) if name == "episode_index" => {}
                Ok(dtype) => {
                    let known = if name == "observation.state" { "proprio" } else { name };
                    add(known, dtype, &shape_of(feature)?, Source::Table(name.clone()));
                }
                Err(reason) => skipped.push((name.clone(), reason)),
            }
        }
        add("ep_idx", Dtype::I32, &[], Source::Episode);
        add("step_idx", Dtype::I64, &[], Source::Step);
        let schema = Schema::new(fields).map_err(|error| error.to_string())?;
        Ok(Self { path: path.to_owned(), schema, columns, episodes, skipped, runs: Vec::new() })
    }

    /// A folder that this program wrote.
    fn ours(path: &Path, manifest: Manifest) -> Result<Self, String> {
        let cameras: Vec<String> = manifest.cameras().map(|(_, camera)| camera).collect();
        let mut places = Vec::new();
        for (episode, entry) in episodes::read(path, cameras.len())?.into_iter().enumerate() {
            let data = path.join(episodes::data_path(episode));
            let mut place = Place { rows: entry.rows, data: data.clone(), ..Place::default() };
            let films = cameras.iter().map(|camera| path.join(episodes::film_path(camera, episode)));
            for (camera, film) in cameras.iter().zip(films.clone()) {
                place.films.insert(camera.clone(), (film, 0));
            }
            place.checksums = std::iter::once(data).chain(films).zip(entry.checksums).collect();
            places.push(place);
        }
        let source = |field: &Field| match manifest.feature(&field.name) {
            camera if is_film(field) => Source::Film(camera),
            name => Source::Table(name),
        };
        let mut columns: Vec<Source> = manifest.columns.iter().map(source).collect();
        let mut fields = manifest.columns;
        fields.push(Field::step("ep_idx", Dtype::I32, &[]));
        columns.push(Source::Episode);
        let schema = Schema::new(fields).map_err(|error| error.to_string())?;
        let path = path.to_owned();
        Ok(Self { path, schema, columns, episodes: places, skipped: Vec::new(), runs: manifest.runs })
    }
}

/// Compares a file of an episode with its checksum, if there is one.
fn check(path: &Path, place: &Place) -> Result<(), String> {
    let Some(&checksum) = place.checksums.get(path) else { return Ok(()) };
    let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    match crc32fast::hash(&bytes) == checksum {
        true => Ok(()),
        false => Err(format!("{}: its checksum is wrong, the file was changed", path.display())),
    }
}

/// The shape of a row; one value is a scalar.
fn shape_of(feature: &Json) -> Result<Vec<usize>, String> {
    let sizes = feature["shape"].as_array().ok_or("a feature has no shape")?;
    let sizes: Option<Vec<usize>> =
        sizes.iter().map(|size| size.as_u64().map(|size| size as usize)).collect();
    let sizes = sizes.ok_or("a feature's shape holds no numbers")?;
    let values = sizes.iter().try_fold(1usize, |values, &size| values.checked_mul(size));
    match values {
        Some(1) => Ok(Vec::new()),
        Some(2..=0x1000_0000) => Ok(sizes),
        _ => Err(format!("a feature has the shape {sizes:?}")),
    }
}

fn film(path: &Path) -> Result<Mp4Reader<BufReader<File>>, String> {
    let file = File::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Mp4Reader::new(BufReader::new(file)).map_err(|error| format!("{}: {error}", path.display()))
}

/// A length that an episode can have.
fn bounded(rows: usize) -> Result<usize, String> {
    match i32::try_from(rows) {
        Ok(_) => Ok(rows),
        Err(_) => Err(format!("an episode of {rows} rows")),
    }
}

/// Version 2: a table and a film per episode, and a list of lengths.
fn second(path: &Path, info: &Info, cameras: &[String]) -> Result<Vec<Place>, String> {
    let list = path.join("meta/episodes.jsonl");
    let failed = |error: std::io::Error| format!("{}: {error}", list.display());
    if fs::metadata(&list).map_err(failed)?.len() > MAX_LIST {
        return Err("its list of episodes is too long".to_owned());
    }
    let text = fs::read_to_string(&list).map_err(failed)?;
    let mut places = Vec::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        let entry: Json =
            serde_json::from_str(line).map_err(|error| format!("{}: {error}", list.display()))?;
        let number = |key: &str| entry[key].as_u64().and_then(|value| usize::try_from(value).ok());
        let (Some(episode), Some(rows)) = (number("episode_index"), number("length")) else {
            return Err(format!("{}: an episode without index or length", list.display()));
        };
        let rows = bounded(rows)?;
        let numbers = [("episode_chunk", episode / info.chunks_size), ("episode_index", episode)];
        let mut place = Place { rows, data: info.data(path, &numbers)?, ..Place::default() };
        for camera in cameras {
            place.films.insert(camera.clone(), (info.film(path, camera, &numbers)?, 0));
        }
        places.push(place);
    }
    Ok(places)
}

/// Version 3: tables that say in which file each episode lies, and where.
fn third(path: &Path, info: &Info, cameras: &[String]) -> Result<Vec<Place>, String> {
    let mut places: Vec<Place> = Vec::new();
    // Rows of a table are counted over all tables: its first episode tells where it begins.
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
                other => Err(format!("column `{name}` holds {} {}", other.len(), other.dtype())),
            };
            let (lengths, starts) = (integers("length")?, integers("dataset_from_index")?);
            let (chunks, files) = (integers("data/chunk_index")?, integers("data/file_index")?);
            let size =
                |value: i64| usize::try_from(value).map_err(|_| format!("the number {value} is negative"));
            let mut films = Vec::new();
            for camera in cameras {
                let key = |what: &str| format!("videos/{camera}/{what}");
                let Column::F64(times) = table.column(&key("from_timestamp"))? else {
                    return Err(format!("column `{}` holds no times", key("from_timestamp")));
                };
                films.push((camera, integers(&key("chunk_index"))?, integers(&key("file_index"))?, times));
            }
            for row in 0..table.rows() {
                let numbers = [("chunk_index", size(chunks[row])?), ("file_index", size(files[row])?)];
                let data = info.data(path, &numbers)?;
                let start = size(starts[row])?;
                let begin = *begins.entry(data.clone()).or_insert(start);
                let first = start.checked_sub(begin).ok_or("episodes are out of order")?;
                let mut place =
                    Place { rows: bounded(size(lengths[row])?)?, data, first, ..Place::default() };
                for (camera, chunks, files, times) in &films {
                    let numbers = [("chunk_index", size(chunks[row])?), ("file_index", size(files[row])?)];
                    let film = info.film(path, camera, &numbers)?;
                    let time = times.get(row).copied().unwrap_or(f64::NAN);
                    if !(0.0..1e9).contains(&time) {
                        return Err(format!("a film begins at {time} s"));
                    }
                    place.films.insert((*camera).clone(), (film, (time * info.fps).round() as usize));
                }
                places.push(place);
            }
        }
    }
    match places.len() == info.total_episodes {
        true => Ok(places),
        false => Err(format!("{} of {} episodes are listed", places.len(), info.total_episodes)),
    }
}

impl EpisodeSource for LeRobotDataset {
    fn schema(&self) -> &Arc<Schema> {
        &self.shared.schema
    }

    fn num_episodes(&self) -> usize {
        self.shared.episodes.len()
    }

    fn episode_len(&self, episode: usize) -> usize {
        self.shared.episodes.get(episode).map_or(0, |place| place.rows)
    }

    fn metadata(&self) -> Option<&Metadata> {
        self.shared.runs.first().map(|(_, metadata)| metadata)
    }

    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        Ok(read_rows(self, episode, rows, out)?)
    }
}

impl Dataset for LeRobotDataset {
    fn path(&self) -> &Path {
        &self.shared.path
    }

    fn format(&self) -> &'static str {
        super::FORMAT.name
    }

    fn read_column(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let shared = self.shared.clone();
        let (field, rows) = locate(&*self, column, episode)?;
        check_request(&shared.path, field, episode, rows, steps, &out)?;
        let width = field.width();
        let read = match (&shared.columns[column], out) {
            (Source::Table(name), out) => self.table_rows(name, episode, width, steps, out),
            (Source::Film(camera), SliceMut::U8(out)) => self.film_rows(column, camera, episode, steps, out),
            (Source::Episode, SliceMut::I32(out)) => {
                out.fill(i32::try_from(episode).unwrap_or(i32::MAX));
                Ok(())
            }
            (Source::Step, SliceMut::I64(out)) => {
                for (at, value) in out.iter_mut().enumerate() {
                    *value = (steps.first + at * steps.stride) as i64;
                }
                Ok(())
            }
            (_, out) => Err(format!("it was asked for as {}", out.dtype())),
        };
        read.map_err(|reason| {
            let name = &shared.schema.fields()[column].name;
            DataError::damaged(&shared.path, format!("column `{name}`, episode {episode}: {reason}"))
        })
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { shared: self.shared.clone(), table: None, films: BTreeMap::new() })
    }

    fn runs(&self) -> &[(u64, Metadata)] {
        &self.shared.runs
    }

    fn has_checksums(&self) -> bool {
        self.shared.episodes.iter().any(|place| !place.checksums.is_empty())
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let Some(place) = self.shared.episodes.get(episode) else { return Ok(()) };
        let checked = place.checksums.keys().try_for_each(|path| check(path, place));
        checked
            .map_err(|reason| DataError::damaged(&self.shared.path, format!("episode {episode}: {reason}")))
    }

    fn skipped(&self) -> &[(String, String)] {
        &self.shared.skipped
    }
}
