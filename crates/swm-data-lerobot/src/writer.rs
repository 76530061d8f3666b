//! Recording into a LeRobot folder, version 3.0. Every episode has a table and videos of its own, which are there before
//! the list of episodes names them; the list appears by renaming. So after a kill at any moment every committed episode
//! is there. `meta/info.json` follows the list, statistics follow at the end of the recording.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Batch, Field, Schema, Slice};
use swm_data::dataset::{Dataset, LastRow, WriteOptions};
use swm_data::error::{DataError, Result, missing};
use swm_data::recording::{self, Backend, Existing, Session, SessionStart, StepIndex, check_fit};
use swm_data::video::{FRAMES_PER_SECOND, encoding};
use swm_files::{WriterLock, is_plain_name};
use swm_media::mp4::Mp4Options;

use super::LEROBOT;
use super::episodes::{self, Entry};
use super::info::{self, INFO};
use super::manifest::{Manifest, OWN, TASK, whole};
use super::open_episode::OpenEpisode;
use super::reader::LeRobotDataset;
use super::statistics::Statistics;
use super::{last_row, tasks};

/// How folders of LeRobot are recorded.
pub(super) struct LeRobotBackend;

/// A folder that is being recorded.
pub(super) struct LeRobotSession {
    path: PathBuf,
    schema: Arc<Schema>,
    manifest: Manifest,
    encoding: Mp4Options,
    entries: Vec<Entry>,
    /// Rows of all committed episodes.
    rows: usize,
    statistics: Statistics,
    open: Option<OpenEpisode>,
    tasks: tasks::Recorded,
    /// The last row so far of the open episode, which may come beside its table.
    pending: Option<Batch>,
    /// Files that may not be on the disk yet.
    unsynced: Vec<PathBuf>,
    assumed_rate: Option<f64>,
}

impl Backend for LeRobotBackend {
    type Session = LeRobotSession;

    fn name(&self) -> &'static str {
        LEROBOT.name
    }

    fn is_folder(&self) -> bool {
        true
    }

    /// Also what a recording leaves that was killed before it began.
    fn is_new(&self, path: &Path) -> Result<bool, DataError> {
        if path.join(INFO).is_file() {
            return Ok(false);
        }
        if !path.exists() {
            return Ok(true);
        }
        let entries = fs::read_dir(path).map_err(|source| DataError::io(path, "open", source))?;
        Ok(entries.flatten().all(|entry| entry.file_name() == "meta"))
    }

    fn is_dataset(&self, path: &Path) -> bool {
        path.join(INFO).is_file()
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        Ok(Box::new(LeRobotDataset::open(path)?))
    }

    fn refuses(&self, name: &str) -> Option<&'static str> {
        (!is_plain_name(name)).then_some("no empty name, no `/`, `\\` or `:`")
    }

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        clear(path)
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<LeRobotSession, DataError> {
        let &SessionStart { path, options, fields, metadata, .. } = start;
        // LeRobot takes whole numbers.
        if let Some(rate) = options.frames_per_second.filter(|rate| rate.fract() != 0.0) {
            let reason = format!("{rate} frames per second; LeRobot takes whole numbers");
            return Err(DataError::record(path, reason));
        }
        let of_rows = metadata.rows_per_second.map(whole);
        let known = options.frames_per_second.or(of_rows);
        let rate = known.unwrap_or(FRAMES_PER_SECOND);
        let is_assumed = known.is_none() && start.existing != Existing::Continued;
        let drops_last_row = options.last_row.unwrap_or(LastRow::Drop) == LastRow::Drop;
        let mut manifest = Manifest::new(fields.to_vec(), rate, drops_last_row);
        check_columns(path, &manifest)?;
        if start.existing == Existing::Continued {
            let there = Manifest::read(path).map_err(|error| DataError::damaged(path, error))?;
            let there = there.ok_or_else(|| recording::foreign(path))?;
            let first = there.runs.first().map_or(metadata, |(_, first)| first);
            check_fit(path, &there.columns, first, &manifest.columns, metadata)?;
            if options.last_row.is_some() && there.drops_last_row != manifest.drops_last_row {
                let reason =
                    "its last rows are kept in another way; leave `last_row` out, or write another dataset";
                return Err(DataError::mismatch(path, reason));
            }
            manifest = there;
        } else if start.existing == Existing::Replaced {
            clear(path)?;
        }
        let runs = recording::with_run(&manifest.runs, start.episodes, metadata);
        let changed = runs != manifest.runs;
        manifest.runs = runs;
        let meta = path.join("meta");
        fs::create_dir_all(&meta).map_err(|source| DataError::io(path, "create", source))?;
        if changed {
            manifest.write(path)?;
            if !manifest.has_tasks {
                tasks::write(path, &[episodes::env(&manifest).to_owned()])?;
            }
        }
        let encoding = Mp4Options { frames_per_second: manifest.frames_per_second, ..encoding(options) };
        let session = LeRobotSession::open(path, start.schema, manifest, encoding)?;
        Ok(LeRobotSession { assumed_rate: is_assumed.then_some(rate), ..session })
    }
}

impl Session for LeRobotSession {
    fn assumed_rate(&self) -> Option<f64> {
        self.assumed_rate
    }

    fn append(&mut self, at: StepIndex, batch: &Batch) -> Result<()> {
        if !self.manifest.drops_last_row || batch.rows() == 0 {
            return self.append_rows(at.step, batch);
        }
        if let Some(row) = self.pending.take() {
            self.append_rows(at.step - 1, &row)?;
        }
        let before = batch.rows() - 1;
        if before > 0 {
            self.append_rows(at.step, &last_row::part(batch, 0, before)?)?;
        }
        self.pending = Some(last_row::part(batch, before, 1)?);
        Ok(())
    }

    /// Its table and videos, the list, the summary.
    fn commit(&mut self, end: StepIndex) -> Result<()> {
        match self.pending.take() {
            // Of an episode of one row, that row stays: it would have none.
            Some(row) if self.open.is_some() && last_row::has_no_action(&row) => {
                let task = self.numbers(&row)?.first().copied().unwrap_or_default();
                self.end_episode(end.step - 1, Some((&row, task)))
            }
            Some(row) => {
                self.append_rows(end.step - 1, &row)?;
                self.end_episode(end.step, None)
            }
            None => self.end_episode(end.step, None),
        }
    }

    fn sync(&mut self) -> Result<()> {
        Ok(sync_below(&self.path, std::mem::take(&mut self.unsynced))?)
    }

    fn close(self) -> Result<()> {
        self.statistics.write(&self.path, &self.manifest)?;
        Ok(sync_below(&self.path, Vec::new())?)
    }
}

impl LeRobotSession {
    /// The numbers of the tasks of rows.
    fn numbers(&mut self, batch: &Batch) -> Result<Vec<i64>> {
        if !self.manifest.has_tasks {
            return Ok(vec![0; batch.rows()]);
        }
        let column = batch.schema().index(TASK).map(|column| batch.column(column));
        let Some(Slice::Str(texts)) = column else { return Err(missing("the column `task` is missing")) };
        Ok(texts.iter().map(|text| self.tasks.number(text)).collect())
    }

    /// Appends rows of the open episode from `first` on.
    fn append_rows(&mut self, first: usize, batch: &Batch) -> Result<()> {
        let numbers = self.numbers(batch)?;
        let open = match &mut self.open {
            Some(open) => open,
            None => {
                let place = (self.entries.len(), self.rows);
                self.open.insert(OpenEpisode::new(&self.path, &self.manifest, &self.encoding, place)?)
            }
        };
        open.append(self.manifest.frames_per_second, &self.schema, batch, &numbers)?;
        self.statistics.add(&self.manifest, first, batch);
        Ok(())
    }

    /// Commits the open episode with so many rows in its table, and the row beside it with its task.
    fn end_episode(&mut self, rows: usize, last_row: Option<(&Batch, i64)>) -> Result<()> {
        let open = self.open.take().ok_or(missing("an episode without rows"))?;
        // Before rows have their numbers.
        let tasks = self.tasks.end_episode(&self.path)?;
        let last_row = last_row.map(|(row, task)| (&*self.schema, row, task));
        let checksums = open.finish(&self.path, self.manifest.frames_per_second, last_row)?;
        let (last_row, checksums) = (checksums.last_row, checksums.files);
        self.entries.push(Entry { rows, checksums, last_row, tasks });
        episodes::commit(&self.path, &self.manifest, &self.entries)?;
        let episode = self.entries.len() - 1;
        let videos = self.manifest.cameras().map(|(_, camera)| episodes::video_path(&camera, episode));
        let last = last_row.map(|_| last_row::path_of(episode));
        let written = [episodes::data_path(episode), episodes::list_of(episode), INFO.to_owned()];
        let written = written.into_iter().chain(last).chain(videos);
        self.unsynced.extend(written.map(|name| self.path.join(name)));
        self.rows += rows;
        self.statistics.end_episode();
        let tasks = if self.manifest.has_tasks { self.tasks.count() } else { 1 };
        Ok(info::write(&self.path, &self.manifest, self.entries.len(), self.rows, tasks)?)
    }
}

/// Brings these files, the descriptions in `meta`, and all folders above them to the disk: a file that no folder names is
/// lost.
fn sync_below(path: &Path, mut files: Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(path.join("meta"))? {
        let entry = entry?;
        if entry.file_type()?.is_file() {
            files.push(entry.path());
        }
    }
    swm_files::sync(&files)?;
    let above = files.iter().flat_map(|file| file.ancestors().skip(1));
    let folders: BTreeSet<&Path> = above.filter(|folder| folder.starts_with(path)).collect();
    swm_files::sync(&folders.into_iter().map(Path::to_owned).collect::<Vec<_>>())
}

impl LeRobotSession {
    /// Continues behind the committed episodes; what lies behind them is removed.
    fn open(
        path: &Path,
        schema: &Arc<Schema>,
        manifest: Manifest,
        encoding: Mp4Options,
    ) -> Result<Self, DataError> {
        let damaged = |error| DataError::damaged(path, error);
        let counted = match path.join(INFO).is_file() {
            true => info::Info::read(path).map_err(damaged)?.total_episodes,
            false => 0,
        };
        let entries = episodes::read_all(path, &manifest, counted).map_err(damaged)?;
        let rows = entries.iter().map(|entry| entry.rows).sum();
        for file in leftovers(path, &manifest, entries.len()) {
            fs::remove_file(&file).map_err(|source| DataError::io(&file, "remove", source))?;
        }
        let tasks = if manifest.has_tasks { tasks::of_ours(path).map_err(damaged)? } else { BTreeMap::new() };
        let count = if manifest.has_tasks { tasks.len() } else { 1 };
        info::write(path, &manifest, entries.len(), rows, count)?;
        let statistics = match Statistics::read(path, &manifest, rows) {
            Some(found) => found,
            None if rows == 0 => Statistics::new(&manifest),
            None => {
                let lengths: Vec<usize> = entries.iter().map(|entry| entry.rows).collect();
                Statistics::compute(&manifest, &mut LeRobotDataset::open(path)?, &lengths)?
            }
        };
        Ok(Self {
            path: path.to_owned(),
            schema: schema.clone(),
            manifest,
            encoding,
            entries,
            rows,
            statistics,
            open: None,
            tasks: tasks::Recorded::new(tasks),
            pending: None,
            unsynced: Vec::new(),
            assumed_rate: None,
        })
    }
}

/// Says what is to be done about an interrupted recording; does it if `apply`.
pub(super) fn repair(path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
    let path = &recording::resolve(path)?;
    let _lock = WriterLock::take(path)?;
    let damaged = |error| DataError::damaged(path, error);
    let Some(manifest) = Manifest::read(path).map_err(damaged)? else { return Ok(Vec::new()) };
    let mut entries = episodes::read(path, manifest.cameras().count()).map_err(damaged)?;
    let mut steps = Vec::new();
    let (listed, counted) = (entries.len(), info::Info::read(path).map_err(damaged)?.total_episodes);
    if counted < listed {
        steps.push(format!("set `{INFO}` from {counted} to {listed} episodes"));
    } else if counted > listed {
        entries.extend(episodes::unlisted(path, &manifest, listed, counted).map_err(damaged)?);
        let count = counted - listed;
        steps.push(format!("list {count} of {counted} episodes again, which `meta/episodes` lacks"));
        if apply {
            episodes::commit_from(path, &manifest, &entries, listed)?;
        }
    }
    let rows = entries.iter().map(|entry| entry.rows).sum();
    if rows > 0 && Statistics::read(path, &manifest, rows).is_none() {
        steps.push("compute `meta/stats.json` anew".to_owned());
    }
    let count = leftovers(path, &manifest, entries.len()).len();
    if count > 0 {
        steps.push(format!("remove {count} files of an unfinished episode"));
    }
    if apply && !steps.is_empty() {
        let schema = LeRobotDataset::open(path)?.schema().clone();
        let recording = LeRobotSession::open(path, &schema, manifest, encoding(&WriteOptions::default()))?;
        recording.statistics.write(path, &recording.manifest)?;
    }
    Ok(steps)
}

/// Files of the episode behind the committed ones.
fn leftovers(path: &Path, manifest: &Manifest, episode: usize) -> Vec<PathBuf> {
    let videos = manifest.cameras().map(|(_, camera)| episodes::video_path(&camera, episode));
    let own = [episodes::data_path(episode), last_row::path_of(episode)];
    let names = own.into_iter().chain(videos);
    let files = names.flat_map(|name| [path.join(format!("{name}.new")), path.join(name)]);
    files.filter(|file| file.is_file()).collect()
}

/// Removes a dataset from its folder; first the file by which it is one.
fn clear(path: &Path) -> Result<(), DataError> {
    let failed = |source| DataError::io(path, "clear", source);
    match fs::remove_file(path.join(INFO)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(failed(error)),
        _ => {}
    }
    for folder in ["data", "videos", "meta"].map(|name| path.join(name)) {
        if folder.is_dir() {
            fs::remove_dir_all(&folder).map_err(failed)?;
        }
    }
    Ok(())
}

/// What this format asks of columns beyond their names.
fn check_columns(path: &Path, manifest: &Manifest) -> Result<(), DataError> {
    let wrong = |reason| Err(DataError::record(path, reason));
    let rate = manifest.frames_per_second;
    if !(rate.is_finite() && rate > 0.0) {
        return wrong(format!("{rate} frames per second"));
    }
    let mut features = Vec::new();
    for Field { name, dtype, shape, .. } in &manifest.columns {
        if OWN.iter().any(|(own, kind)| own == name && (kind != dtype || !shape.is_empty())) {
            return wrong(format!("the name `{name}` is LeRobot's own, for a single number of another kind"));
        }
        let feature = manifest.feature(name);
        if features.contains(&feature) {
            return wrong(format!("two columns would be called `{feature}`"));
        }
        features.push(feature);
    }
    Ok(())
}
