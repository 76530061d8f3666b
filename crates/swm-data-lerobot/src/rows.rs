//! Which rows of which table are those of an episode. The list of episodes names a table and counts rows; the tables themselves say
//! of every row which episode it belongs to. What they say counts: a list may name the file before (LeRobot's converter once did), as
//! LeRobot itself reads all tables as one.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use swm_data::error::{At as _, Result, invalid};

use super::episode_files::EpisodeFiles;
use super::table::Table;

/// The folder of all tables.
const DATA: &str = "data";
/// Folders within folders that are looked through for tables.
const DEPTH: usize = 3;

/// Where the rows of an episode are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) data: PathBuf,
    /// Its first row in the table.
    pub(super) first: usize,
}

/// Rows on end, by table.
type Runs = Vec<(PathBuf, Range<usize>)>;

/// Where the rows of all episodes are, found when they are asked for first.
#[derive(Debug, Default)]
pub(super) struct Places {
    folder: PathBuf,
    /// By table: the episodes that the list places there.
    listed: BTreeMap<PathBuf, Vec<usize>>,
    /// By episode.
    found: Vec<OnceLock<Place>>,
    /// By number of an episode: all rows of tables that say it is theirs. Found when a table contradicts the list.
    runs: OnceLock<BTreeMap<i64, Runs>>,
}

/// The labels of rows in a table (`episode_index` and the like); `None`: nothing.
pub(super) struct Labels {
    /// The number of their episode.
    pub(super) episodes: Option<Vec<i64>>,
    /// Their number in the episode.
    pub(super) frames: Option<Vec<i64>>,
    /// Their number in the dataset.
    pub(super) indices: Option<Vec<i64>>,
}

impl Labels {
    /// Those of a table.
    ///
    /// # Errors
    ///
    /// A column of them cannot be decoded.
    pub(super) fn of(table: &Table) -> Result<Self> {
        Ok(Self {
            episodes: table.integers("episode_index")?,
            frames: table.integers("frame_index")?,
            indices: table.integers("index")?,
        })
    }

    /// Compares the rows of a table with the episode that they should be.
    ///
    /// # Errors
    ///
    /// What the rows say instead.
    pub(super) fn check(&self, number: i64, rows: Range<usize>) -> Result<()> {
        let place = format!("rows {} to {}", rows.start, rows.end.saturating_sub(1));
        if let Some(all) = &self.episodes {
            let Some(own) = all.get(rows.clone()) else {
                return Err(invalid(format!("it has {} rows, and not {place}", all.len())));
            };
            if let Some(other) = own.iter().find(|&&found| found != number) {
                return Err(invalid(format!("{place} are of episode {other} by their `episode_index`")));
            }
            let around = [rows.start.checked_sub(1), Some(rows.end)];
            if around.into_iter().flatten().any(|at| all.get(at) == Some(&number)) {
                return Err(invalid(format!(
                    "more rows than {place} are of episode {number} by their `episode_index`"
                )));
            }
        }
        for (name, labels) in [("frame_index", &self.frames), ("index", &self.indices)] {
            let Some(own) = labels.as_ref().and_then(|all| all.get(rows.clone())) else { continue };
            if let Some(at) = own.windows(2).position(|pair| pair[0] >= pair[1]) {
                let (at, pair) = (rows.start + at + 1, [own[at], own[at + 1]]);
                return Err(invalid(format!("row {at} has the `{name}` {}, behind {}", pair[1], pair[0])));
            }
        }
        Ok(())
    }
}

impl Places {
    pub(super) fn new(folder: &Path, episodes: &[EpisodeFiles]) -> Self {
        let mut listed: BTreeMap<PathBuf, Vec<usize>> = BTreeMap::new();
        for (episode, files) in episodes.iter().enumerate() {
            listed.entry(files.data.clone()).or_default().push(episode);
        }
        let found = (0..episodes.len()).map(|_| OnceLock::new()).collect();
        Self { folder: folder.to_owned(), listed, found, runs: OnceLock::new() }
    }

    /// Where the rows of an episode are.
    ///
    /// # Errors
    ///
    /// The table contradicts the list, and no other rows can be those of the episode.
    pub(super) fn of(&self, episodes: &[EpisodeFiles], episode: usize) -> Result<&Place> {
        if let Some(found) = self.found[episode].get() {
            return Ok(found);
        }
        let files = &episodes[episode];
        let wrong = match Table::open(&files.data).and_then(|table| Labels::of(&table)) {
            Err(error) => error,
            Ok(labels) => {
                // The other episodes of the table, too, so that it is looked at once.
                for &other in self.listed.get(&files.data).into_iter().flatten() {
                    let EpisodeFiles { number, first, rows, data, .. } = &episodes[other];
                    let rows = *first..first.saturating_add(*rows);
                    if other != episode && labels.check(*number, rows).is_ok() {
                        self.found[other].get_or_init(|| Place { data: data.clone(), first: *first });
                    }
                }
                match labels.check(files.number, files.first..files.first.saturating_add(files.rows)) {
                    Ok(()) => {
                        let place = Place { data: files.data.clone(), first: files.first };
                        return Ok(self.found[episode].get_or_init(|| place));
                    }
                    Err(wrong) => wrong,
                }
            }
        };
        match self.search(files) {
            Some(place) => Ok(self.found[episode].get_or_init(|| place)),
            None => Err(wrong).at(format_args!(
                "the list places episode {} in {}, and of all tables, not exactly one has its {} rows",
                files.number,
                self.name(&files.data),
                files.rows
            )),
        }
    }

    /// The only rows of all tables that can be those of an episode.
    fn search(&self, files: &EpisodeFiles) -> Option<Place> {
        let runs = self.runs.get_or_init(|| self.all_runs());
        let [(data, rows)] = runs.get(&files.number)?.as_slice() else { return None };
        let labels = Labels::of(&Table::open(data).ok()?).ok()?;
        let fits = rows.len() == files.rows && labels.check(files.number, rows.clone()).is_ok();
        fits.then(|| Place { data: data.clone(), first: rows.start })
    }

    fn all_runs(&self) -> BTreeMap<i64, Runs> {
        let mut runs: BTreeMap<i64, Runs> = BTreeMap::new();
        for path in tables(&self.folder.join(DATA), DEPTH) {
            // What cannot be read here is an error where the list places an episode there.
            let Ok(numbers) = Table::open(&path).and_then(|table| table.integers("episode_index")) else {
                continue;
            };
            let numbers = numbers.unwrap_or_default();
            let mut begin = 0;
            for run in numbers.chunk_by(|a, b| a == b) {
                runs.entry(run[0]).or_default().push((path.clone(), begin..begin + run.len()));
                begin += run.len();
            }
        }
        runs
    }

    /// A file of the folder, as messages name it.
    pub(super) fn name(&self, file: &Path) -> String {
        file.strip_prefix(&self.folder).unwrap_or(file).display().to_string()
    }
}

/// All tables below a folder.
fn tables(folder: &Path, depth: usize) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = Vec::new();
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    entries.sort();
    for path in entries {
        if path.extension().is_some_and(|extension| extension == "parquet") {
            found.push(path);
        } else if depth > 0 && path.is_dir() {
            found.extend(tables(&path, depth - 1));
        }
    }
    found
}
