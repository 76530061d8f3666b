//! Reading rows of an open LeRobot folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Column, Dtype, SliceMut};
use swm_data::OpenOptions;
use swm_data::dataset::{CHANGED, Dataset, DatasetInfo, Origin, Steps, copy_rows};
use swm_data::error::{At as _, DataError, Result, invalid, missing, wrong_type};
use swm_files::read_regular;

use super::camera::{Camera, TIMESTAMP, Times};
use super::check::check;
use super::contents::{Shared, Source};
use super::episode_files::EpisodeFiles;
use super::images::Encoded;
use super::rows::Place;
use super::table::Table;
use super::tasks::{self, TASK_INDEX};

/// An open folder.
pub(super) struct LeRobotDataset {
    shared: Arc<Shared>,
    /// The columns of the table that was read last.
    table: Option<(PathBuf, BTreeMap<String, Column>)>,
    videos: BTreeMap<usize, Camera>,
    /// The times of the rows of a table, if it has some.
    times: Option<(PathBuf, Option<Column>)>,
    /// By column: the episode whose encoded images were read last.
    images: BTreeMap<usize, (usize, Vec<Encoded>)>,
}

impl LeRobotDataset {
    pub(super) fn open(path: &Path) -> Result<Self, DataError> {
        Self::open_with(path, &OpenOptions::default())
    }

    /// As [`LeRobotDataset::open`]; of the options, `camera` and `map` act here.
    pub(super) fn open_with(path: &Path, options: &OpenOptions) -> Result<Self, DataError> {
        let shared = Shared::open(path, options)?;
        Ok(Self {
            shared: Arc::new(shared),
            table: None,
            videos: BTreeMap::new(),
            times: None,
            images: BTreeMap::new(),
        })
    }

    fn table_rows(
        &mut self,
        name: &str,
        episode: usize,
        width: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<()> {
        let shared = self.shared.clone();
        let rows = shared.episodes[episode].rows;
        // The last one may be beside the table.
        let is_beside = steps.count > 0 && steps.first + (steps.count - 1) * steps.stride == rows;
        let (steps, out) = match &shared.episodes[episode].last_row {
            Some(path) if is_beside => {
                let (out, mut last) = out.split_at((steps.count - 1) * width);
                let column = Table::open(path)?.column(name).at(path.display())?;
                let column = narrowed(column, last.dtype());
                if column.len() != width || !last.copy_from(column.as_slice()) {
                    return Err(wrong_type(format!("{} does not hold one row", path.display())));
                }
                (Steps { count: steps.count - 1, ..steps }, out)
            }
            _ => (steps, out),
        };
        if steps.count == 0 {
            return Ok(());
        }
        let Place { data, first } = shared.places.of(&shared.episodes, episode)?;
        if self.table.as_ref().is_none_or(|(path, _)| path != data) {
            self.table = Some((data.clone(), BTreeMap::new()));
        }
        let Some((path, columns)) = &mut self.table else { return Ok(()) };
        if !columns.contains_key(name) {
            let table = Table::open(path)?;
            let values = narrowed(table.column(name).at(path.display())?, out.dtype());
            // Lists of other lengths would move the rows behind them.
            if table.rows().checked_mul(width) != Some(values.len()) {
                let reason = format!(
                    "{} has {} values in {} rows, not {width} in each",
                    path.display(),
                    values.len(),
                    table.rows()
                );
                return Err(wrong_type(reason));
            }
            columns.insert(name.to_owned(), values);
        }
        let values = columns[name].as_slice();
        let (start, size) = (first.checked_mul(width), rows.checked_mul(width));
        let fits = start
            .zip(size)
            .and_then(|(start, size)| start.checked_add(size))
            .is_some_and(|end| end <= values.len());
        if !fits || values.dtype() != out.dtype() {
            return Err(wrong_type(format!(
                "{} does not hold rows {} to {}",
                path.display(),
                first,
                first.saturating_add(rows)
            )));
        }
        copy_rows(values.range(first * width, rows * width), width, steps, out);
        Ok(())
    }

    fn task_rows(
        &mut self,
        texts: &BTreeMap<i64, String>,
        episode: usize,
        steps: Steps,
        out: &mut [String],
    ) -> Result<()> {
        let mut numbers = vec![0; out.len()];
        self.table_rows(TASK_INDEX, episode, 1, steps, SliceMut::I64(&mut numbers))?;
        for (at, (out, number)) in out.iter_mut().zip(numbers).enumerate() {
            out.clone_from(tasks::text(texts, number, steps.first + at * steps.stride)?);
        }
        Ok(())
    }

    /// The text of the task of an episode, which its rows must have, too: LeRobot reads theirs.
    fn task_of_episode(
        &mut self,
        texts: &BTreeMap<i64, String>,
        episode: usize,
        steps: Steps,
        out: &mut [String],
    ) -> Result<()> {
        let shared = self.shared.clone();
        let own = shared.episodes[episode].task.as_deref().unwrap_or_default();
        self.task_rows(texts, episode, steps, out)?;
        match out.iter().position(|text| text != own) {
            None => Ok(()),
            Some(at) => Err(invalid(format!(
                "the task of row {} is `{}` by its `{TASK_INDEX}`, and `{own}` in the list of episodes; write the right one into both",
                steps.first + at * steps.stride,
                out[at]
            ))),
        }
    }

    fn video_rows(
        &mut self,
        column: usize,
        camera: &str,
        episode: usize,
        steps: Steps,
        out: &mut [u8],
    ) -> Result<()> {
        let shared = self.shared.clone();
        let files = &shared.episodes[episode];
        let (path, begin) = files.videos.get(camera).ok_or(missing("there is no video"))?;
        if self.videos.get(&column).is_none_or(|open| open.path() != path) {
            // The decoder of damaged videos is the least robust part of all.
            check_file(path, files)?;
            self.videos.insert(column, Camera::open(path)?);
        }
        let Some(video) = self.videos.get_mut(&column) else { return Ok(()) };
        let (height, width) = video.size();
        if shared.info.field(column).shape != [height, width, 3] {
            return Err(wrong_type(format!("it has images of {height} x {width}"))).at(path.display());
        }
        let Some(begin) = *begin else { return video.read(None, steps, out) };
        let Place { data, first } = shared.places.of(&shared.episodes, episode)?;
        if self.times.as_ref().is_none_or(|(read, _)| read != data) {
            let table = Table::open(data)?;
            let times = table.has(TIMESTAMP).then(|| table.column(TIMESTAMP)).transpose()?;
            self.times = Some((data.clone(), times));
        }
        let times = match &self.times {
            Some((_, Some(times))) => Times::Table(times, *first),
            _ => Times::Rate(shared.info.rows_per_second.unwrap_or(f64::NAN)),
        };
        video.read(Some((begin, &times)), steps, out)
    }

    fn image_rows(
        &mut self,
        column: usize,
        name: &str,
        episode: usize,
        steps: Steps,
        out: &mut [u8],
    ) -> Result<()> {
        let shared = self.shared.clone();
        let &[height, width, colors] = &shared.info.field(column).shape[..] else { return Ok(()) };
        if self.images.get(&column).is_none_or(|&(read, _)| read != episode) {
            let Place { data, first } = shared.places.of(&shared.episodes, episode)?;
            let end = first.checked_add(shared.episodes[episode].rows).ok_or(invalid("it ends nowhere"))?;
            let images = Table::open(data)?.images(name, *first..end).at(data.display())?;
            self.images.insert(column, (episode, images));
        }
        let Some((_, images)) = self.images.get(&column) else { return Ok(()) };
        for (at, out) in out.chunks_exact_mut(height * width * colors).enumerate() {
            let row = steps.first + at * steps.stride;
            let image = images.get(row).ok_or(missing(format!("row {row} is not there")))?;
            let read = image.decode(&shared.info.path, [height, width, colors], out);
            read.at(format_args!("row {row}"))?;
        }
        Ok(())
    }
}

/// The values of a column in its own type; tables have none of bytes, and may have smaller numbers than those of tasks.
fn narrowed(column: Column, dtype: Dtype) -> Column {
    match (column, dtype) {
        (Column::I32(values), Dtype::U8) => Column::U8(values.into_iter().map(|value| value as u8).collect()),
        (Column::I32(values), Dtype::I64) => Column::I64(values.into_iter().map(i64::from).collect()),
        (column, _) => column,
    }
}

/// Compares a file of an episode with its checksum, if there is one.
fn check_file(path: &Path, files: &EpisodeFiles) -> Result<()> {
    let Some(&checksum) = files.checksums.get(path) else { return Ok(()) };
    let bytes = read_regular(path).at(path.display())?;
    match crc32fast::hash(&bytes) == checksum {
        true => Ok(()),
        false => Err(invalid(CHANGED)).at(path.display()),
    }
}

impl Dataset for LeRobotDataset {
    fn info(&self) -> &DatasetInfo {
        &self.shared.info
    }

    fn origin(&self) -> Option<Origin> {
        Some(Origin::of(&self.shared.info))
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let shared = self.shared.clone();
        let width = shared.info.field(column).dim();
        let read = match (&shared.columns[column], out) {
            (Source::Table(name), out) => self.table_rows(name, episode, width, steps, out),
            (Source::Video(camera), SliceMut::U8(out)) => {
                self.video_rows(column, camera, episode, steps, out)
            }
            (Source::Images(name), SliceMut::U8(out)) => self.image_rows(column, name, episode, steps, out),
            (Source::Episode, SliceMut::I32(out)) => {
                out.fill(i32::try_from(episode).unwrap_or(i32::MAX));
                Ok(())
            }
            (Source::Task(Some(texts)), SliceMut::Str(out)) => {
                self.task_of_episode(texts, episode, steps, out)
            }
            (Source::Task(None), SliceMut::Str(out)) => {
                out.fill(shared.episodes[episode].task.clone().unwrap_or_default());
                Ok(())
            }
            (Source::Tasks(texts), SliceMut::Str(out)) => self.task_rows(texts, episode, steps, out),
            (Source::Step, SliceMut::I64(out)) => {
                for (at, value) in out.iter_mut().enumerate() {
                    *value = (steps.first + at * steps.stride) as i64;
                }
                Ok(())
            }
            (_, out) => Err(wrong_type(format!("it was asked for as {}", out.dtype()))),
        };
        read.map_err(|error| shared.info.damaged(column, episode, error))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self {
            shared: self.shared.clone(),
            table: None,
            videos: BTreeMap::new(),
            times: None,
            images: BTreeMap::new(),
        })
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        let path = &self.shared.info.path;
        check(path, &self.shared).map_err(|error| DataError::damaged(path, error))
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let Some(files) = self.shared.episodes.get(episode) else { return Ok(()) };
        let checked = files.checksums.keys().try_for_each(|path| check_file(path, files));
        checked.map_err(|error| self.info().damaged_episode(episode, error))
    }
}
