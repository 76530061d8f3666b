//! Folders of episodes as Dreamer's agents record them, and V-D4RL publishes them: an `.npz` archive for each episode.
//!
//! Source of the layout: v-d4rl 425206b, `offlinedv2/dreamerv2/common/driver.py` and `replay.py`. A row holds an image, and the action and
//! reward that led to it; those of the first row are zeros.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Column, Dtype, SliceMut};
use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, Steps};
use swm_data::element::Element;
use swm_data::error::{At as _, DataError, Result, invalid, missing, unsupported};
use swm_data::npz::{self, ArrayType};

use super::array::{Array, Memory, Scratch, Shared, new_key, numbers, widen};
use super::dataset::Span;
use super::found::{Found, Source};
use super::npz::names;

const NAME: &str = "dreamer";

/// Arrays that an archive has, and of which it has one: old versions have no `is_first`.
const SIGNS: [&str; 2] = ["action", "reward"];
const MARKS: [&str; 2] = ["is_first", "discount"];
/// What becomes `terminated` and `truncated`.
const IS_TERMINAL: &str = "is_terminal";
const IS_LAST: &str = "is_last";
/// Episodes, at most.
const MAX_EPISODES: usize = 1 << 20;

pub(super) fn detect(path: &Path) -> bool {
    let first = if path.is_dir() { files(path).into_iter().next() } else { Some(path.to_owned()) };
    first.is_some_and(|first| {
        swm_files::is_zip(&first)
            && npz::members(&first).is_ok_and(|names| {
                let has = |name: &&str| names.iter().any(|there| there == name);
                SIGNS.iter().all(has) && MARKS.iter().any(has)
            })
    })
}

/// The archives of a folder. Their names begin with the time of recording.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(MAX_EPISODES);
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|kind| kind == "npz"))
        .collect();
    files.sort();
    files
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let files = if path.is_dir() { files(path) } else { vec![path.to_owned()] };
    let found = find(&files, options.storage.as_deref()).map_err(|error| DataError::damaged(path, error))?;
    found.open(path, NAME, options, &["storage"])
}

fn member(path: &Path, name: &str, storage: Option<&Path>) -> Result<npz::Array> {
    npz::Array::open_member(path, &format!("{name}.npy"), storage).at(format_args!("array `{name}`"))
}

/// Whether each row of an episode is terminal. Old versions tell it by the discount behind it.
fn ends(file: &Path, names: &BTreeSet<String>, rows: usize, storage: Option<&Path>) -> Result<Vec<bool>> {
    let marks = |name: &str| -> Result<Vec<f64>> {
        let marks = numbers(&Values::open(file, name, storage)?, &mut Scratch::default())?;
        match marks.len() == rows {
            true => Ok(marks),
            false => Err(invalid(format!("{} values of `{name}`, and {rows} of `reward`", marks.len()))),
        }
    };
    Ok(match names.contains(IS_TERMINAL) {
        true => marks(IS_TERMINAL)?.into_iter().map(|mark| mark != 0.0).collect(),
        false if names.contains("discount") => {
            marks("discount")?.into_iter().map(|discount| discount == 0.0).collect()
        }
        false => vec![false; rows],
    })
}

/// The arrays of a name, of the episodes that have it. Only the first of these is opened; others are, when they are read.
fn arrays(
    name: &str,
    files: &[(&PathBuf, usize, bool)],
    storage: Option<&Path>,
) -> Result<Result<Vec<Option<Shared>>, String>> {
    let Some(&(first, rows, _)) = files.iter().find(|(.., is_there)| *is_there) else {
        return Ok(Ok(vec![None; files.len()]));
    };
    let model = match Values::open(first, name, storage) {
        Ok(model) if model.rows != rows => {
            let reason = format!("it has {} rows, and `reward` has {rows}", model.rows);
            Err(invalid(reason).at(format_args!("array `{name}`")))
        }
        Err(error) if !error.is_unsupported() => return Err(error.at(first.display())),
        model => model,
    };
    let model = match model {
        Ok(model) => model,
        Err(error) if SIGNS.contains(&name) => return Err(error.at(first.display())),
        Err(error) => return Ok(Err(error.to_string())),
    };
    let array = |&(file, rows, is_there): &(&PathBuf, usize, bool)| -> Option<Shared> {
        let values = || Values { path: file.clone(), rows, key: new_key(), ..model.clone() };
        is_there.then(|| Arc::new(values()) as Shared)
    };
    Ok(Ok(files.iter().map(array).collect()))
}

fn find(files: &[PathBuf], storage: Option<&Path>) -> Result<Found> {
    if files.is_empty() {
        return Err(missing("the folder has no archive"));
    }
    let (names, of_files) = names(files)?;
    let mut found = Found::default();
    let (mut terminal, mut last) = (Vec::new(), Vec::new());
    for (file, names) in files.iter().zip(&of_files) {
        let lacking: Vec<&str> = SIGNS.into_iter().filter(|sign| !names.contains(*sign)).collect();
        if !lacking.is_empty() {
            return Err(missing(format!("it has no `{}`", lacking.join("` and no `"))).at(file.display()));
        }
        let rows = member(file, "reward", storage).at(file.display())?.rows();
        let ends = ends(file, names, rows, storage).at(file.display())?;
        last.extend(ends.iter().enumerate().map(|(row, end)| row + 1 == rows && !end));
        terminal.extend(ends);
        found.lengths.push(rows);
    }
    let spans = |skipped: usize| -> Vec<Span> {
        let of = |(array, &rows): (usize, &usize)| {
            let first = skipped.min(rows);
            Span { array, first, count: rows - first, tail: None }
        };
        found.lengths.iter().enumerate().map(of).collect()
    };
    // What led to a row belongs to the row before.
    let (whole, without_first) = (spans(0), spans(1));
    for name in names.iter().filter(|name| ![IS_TERMINAL, IS_LAST].contains(&name.as_str())) {
        let file = |(file, path): (usize, _)| (path, found.lengths[file], of_files[file].contains(name));
        let files: Vec<_> = files.iter().enumerate().map(file).collect();
        match arrays(name, &files, storage)? {
            Ok(arrays) => {
                let spans = if SIGNS.contains(&name.as_str()) { &without_first } else { &whole };
                found.add_partial(name, name, arrays, spans);
            }
            Err(reason) => found.skipped.push((name.clone(), reason)),
        }
    }
    for (old, new, marks) in [(IS_TERMINAL, "terminated", terminal), (IS_LAST, "truncated", last)] {
        let spans = found.end_to_end();
        found.sources.push(Source::step(old, new, vec![Memory::marks(marks)], spans));
    }
    found.notes.push(
        "its rows hold the action and the reward that led to an image; here they are in the row before, from which the action was taken, \
         and missing in the last row of an episode; `discount` is in the row of its image; the last row is `truncated` where it is not \
         `terminated`"
            .to_owned(),
    );
    Ok(found)
}

/// An array of one episode, which is decoded when it is read.
#[derive(Clone, Debug)]
struct Values {
    path: PathBuf,
    name: String,
    elements: ArrayType,
    /// Of a row.
    shape: Vec<usize>,
    rows: usize,
    storage: Option<PathBuf>,
    key: usize,
}

impl Values {
    fn open(path: &Path, name: &str, storage: Option<&Path>) -> Result<Self> {
        let array = member(path, name, storage)?;
        Ok(Self {
            path: path.to_owned(),
            name: name.to_owned(),
            elements: array.elements(),
            shape: array.row_shape().to_vec(),
            rows: array.rows(),
            storage: storage.map(Path::to_owned),
            key: new_key(),
        })
    }

    fn decoded(&self) -> Result<npz::Array> {
        let array = member(&self.path, &self.name, self.storage.as_deref())?;
        if array.rows() != self.rows {
            return Err(invalid(format!("it has {} rows, and `reward` has {}", array.rows(), self.rows)));
        }
        match array.row_shape() == self.shape {
            true => Ok(array),
            false => Err(unsupported(format!(
                "its rows are {:?} here, and {:?} in the first episode; store all in one shape",
                array.row_shape(),
                self.shape
            ))),
        }
    }
}

impl Array for Values {
    fn dtype(&self) -> Dtype {
        self.elements.dtype()
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn is_u64(&self) -> bool {
        self.elements == ArrayType::Plain(Element::U64)
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let make = |_: &mut Scratch| {
            let bytes = self.rows.saturating_mul(self.dim()).saturating_mul(8);
            Ok((self.decoded()?, bytes / if self.dtype() == Dtype::U8 { 8 } else { 1 }))
        };
        let place = || format!("{}, array `{}`", self.path.display(), self.name);
        let array: &mut npz::Array = scratch.part((self.key, 0), make).at(place())?;
        let own = array.elements().dtype();
        let steps = (rows.first, rows.count, rows.stride);
        if own == out.dtype() {
            return array.read(steps, out, &mut Vec::new());
        }
        let mut column = Column::zeros(own, out.len());
        array.read(steps, column.as_slice_mut(), &mut Vec::new())?;
        widen(&column, out).at(place())
    }
}
