//! Archives of OGBench and PLDM: flat arrays of all steps, with a mark in the last row of each episode.
//!
//! Sources of the layouts: ogbench 1.2.2, `data_gen_scripts`; PLDM cbaf674, `prepare_npz.py`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, Steps};
use swm_data::element::Element;
use swm_data::error::{At as _, DataError, Result, invalid};
use swm_data::npz::{self, ArrayType};
use swm_files::Readable;
use swm_files::remote::is_remote;

use super::array::{Array, Memory, Scratch, Shared, numbers};
use super::dataset::Span;
use super::found::{Found, Source};
use super::hdf5::scalars;

pub(super) const NAME: &str = "ogbench";

/// Arrays that both have.
const SIGNS: [&str; 3] = ["observations", "actions", "terminals"];
/// The array that only PLDM has.
const PLDM: &str = "proprio_states";
/// Archives of a folder that are looked at.
const MAX_FILES: usize = 10_000;
/// What follows the name of the training part in that of the other.
const VALIDATION: &str = "-val";

pub(super) fn detect(path: &Path) -> bool {
    let first = if path.is_dir() { files(path).into_iter().next() } else { Some(path.to_owned()) };
    first.is_some_and(|first| {
        swm_files::is_zip(&first)
            && npz::members(&first)
                .is_ok_and(|names| SIGNS.iter().all(|sign| names.iter().any(|name| name == sign)))
    })
}

/// The archives of a folder, in the order of the numbers in their names.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(MAX_FILES);
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|kind| kind == "npz"))
        .collect();
    files.sort_by_key(|path| super::natural(&stem(path)));
    files
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let split = options.split.as_deref();
    let (part, files, note) = if path.is_dir() {
        let (files, note) = part_of_folder(path, split)?;
        (path.to_owned(), files, note)
    } else {
        let (part, note) = part(path, split)?;
        (part.clone(), vec![part], note)
    };
    let found = find(&files, options.storage.as_deref());
    let mut found = found.map_err(|error| DataError::damaged(&part, error))?;
    found.notes.extend(note);
    found.notes.extend(files.first().and_then(|first| environment(&stem(first))));
    found.open(&part, NAME, options, &["split", "storage"])
}

fn unknown_part(name: &str) -> DataError {
    let reason = format!("there is no part `{name}`; datasets of OGBench have train and val");
    DataError::Option { option: "split", reason }
}

/// The files of a part in a folder, and a note about those of the other one.
fn part_of_folder(folder: &Path, split: Option<&str>) -> Result<(Vec<PathBuf>, Option<String>), DataError> {
    let (val, train): (Vec<PathBuf>, Vec<PathBuf>) =
        files(folder).into_iter().partition(|path| stem(path).ends_with(VALIDATION));
    let (chosen, name) = match split {
        None if train.is_empty() => return Ok((val, None)),
        None => {
            let note =
                || format!("{} files of it are the part `val`; the option `split` names it", val.len());
            let note = (!val.is_empty()).then(note);
            return Ok((train, note));
        }
        Some("train") => (train, "NAME.npz"),
        Some("val") => (val, "NAME-val.npz"),
        Some(other) => return Err(unknown_part(other)),
    };
    if chosen.is_empty() {
        let reason = format!("the folder has no files of this part, which are called `{name}`");
        return Err(DataError::Option { option: "split", reason });
    }
    Ok((chosen, None))
}

/// The file of a part, and a note about the other one.
fn part(path: &Path, split: Option<&str>) -> Result<(PathBuf, Option<String>), DataError> {
    let name = stem(path);
    let beside = |name: String| path.with_file_name(name).with_extension("npz");
    let (train, val) = match name.strip_suffix(VALIDATION) {
        Some(train) => (beside(train.to_owned()), path.to_owned()),
        None => (path.to_owned(), beside(format!("{name}{VALIDATION}"))),
    };
    let chosen = match split {
        None => {
            let note = (path != val && val.is_file())
                .then(|| format!("the part `val` is beside it, {}; the option `split` names it", stem(&val)));
            return Ok((path.to_owned(), note));
        }
        Some("train") => train,
        Some("val") => val,
        Some(other) => return Err(unknown_part(other)),
    };
    let is_there = chosen.exists() || is_remote(&chosen) && Readable::open(&chosen).is_ok();
    match is_there {
        true => Ok((chosen, None)),
        false => {
            let reason = format!("the file of this part, {}, is missing", chosen.display());
            Err(DataError::Option { option: "split", reason })
        }
    }
}

/// An array of an archive.
#[derive(Debug)]
struct Member(npz::Array);

impl Array for Member {
    fn dtype(&self) -> Dtype {
        self.0.elements().dtype()
    }

    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn shape(&self) -> &[usize] {
        self.0.row_shape()
    }

    fn is_u64(&self) -> bool {
        self.0.elements() == ArrayType::Plain(Element::U64)
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        self.0.read((rows.first, rows.count, rows.stride), out, &mut scratch.bytes)
    }
}

/// The new names of arrays that are not images.
const NAMES: &[(&str, &str)] =
    &[("observations", "observation"), ("actions", "action"), ("rewards", "reward"), (PLDM, "proprio")];

/// The names of the arrays of any archive, each once; those of the first come first. And, by archive, which it has.
pub(super) fn names(files: &[PathBuf]) -> Result<(Vec<String>, Vec<BTreeSet<String>>)> {
    let (mut all, mut of_files): (Vec<String>, Vec<BTreeSet<String>>) = Default::default();
    let mut known = BTreeSet::new();
    for file in files {
        let names = npz::members(file).at(file.display())?;
        all.extend(names.iter().filter(|name| known.insert((*name).clone())).cloned());
        of_files.push(names.into_iter().collect());
    }
    Ok((all, of_files))
}

/// The arrays of a name, of the archives that have it; the inner error says why they become no column.
fn arrays(
    name: &str,
    files: &[(&PathBuf, usize, bool)],
    storage: Option<&Path>,
) -> Result<Result<Vec<Option<Shared>>, String>> {
    let mut arrays: Vec<Option<Shared>> = Vec::new();
    for &(path, rows, is_there) in files {
        if !is_there {
            arrays.push(None);
            continue;
        }
        let array = match open_member(path, name, storage) {
            Ok(array) if array.rows() != rows => {
                Err(invalid(format!("it has {} rows, `terminals` has {rows}", array.rows())))
            }
            Err(error) if !error.is_unsupported() => return Err(error.at(path.display())),
            opened => opened,
        };
        match array {
            Ok(array) if name == "rewards" => arrays.push(Some(scalars(Arc::new(Member(array))))),
            Ok(array) => arrays.push(Some(Arc::new(Member(array)))),
            Err(error) if SIGNS.contains(&name) => return Err(error.at(path.display())),
            Err(error) => return Ok(Err(error.to_string())),
        }
    }
    Ok(Ok(arrays))
}

fn open_member(path: &Path, name: &str, storage: Option<&Path>) -> Result<npz::Array> {
    npz::Array::open_member(path, &format!("{name}.npy"), storage).at(format_args!("array `{name}`"))
}

fn find(files: &[PathBuf], storage: Option<&Path>) -> Result<Found> {
    if files.is_empty() {
        return Err(invalid("the folder has no archive"));
    }
    let (names, of_files) = names(files)?;
    let mut found = Found::default();
    let mut starts: Vec<(usize, usize)> = Vec::new();
    let (mut rows, mut last_rows) = (Vec::new(), Vec::new());
    for (file, path) in files.iter().enumerate() {
        let ends = open_member(path, "terminals", storage)
            .and_then(|ends| numbers(&Member(ends), &mut Scratch::default()));
        let ends = ends.at(path.display())?;
        let mut first = 0;
        for row in 0..ends.len() {
            // The mark of the last episode may be missing.
            if ends[row] != 0.0 || row + 1 == ends.len() {
                starts.push((file, first));
                found.lengths.push(row + 1 - first);
                last_rows.push(ends[row] != 0.0);
                first = row + 1;
            }
        }
        rows.push(ends.len());
    }
    let spans = |missing: usize| -> Vec<Span> {
        let lengths = starts.iter().zip(&found.lengths);
        lengths
            .map(|(&(array, first), &length)| Span {
                array,
                first,
                count: length.saturating_sub(missing),
                tail: None,
            })
            .collect()
    };
    let (whole, without_last) = (spans(0), spans(1));
    for name in names.iter().filter(|name| *name != "terminals") {
        let is_there = |file: usize| SIGNS.contains(&name.as_str()) || of_files[file].contains(name);
        let files: Vec<_> =
            files.iter().enumerate().map(|(file, path)| (path, rows[file], is_there(file))).collect();
        let new = NAMES.iter().find(|(old, _)| old == name).map_or(name.as_str(), |(_, new)| new);
        match arrays(name, &files, storage)? {
            Ok(arrays) => {
                let spans = if name == "actions" { &without_last } else { &whole };
                found.add_partial(name, new, arrays, spans);
            }
            Err(reason) => found.skipped.push((name.clone(), reason)),
        }
    }
    let ends = found
        .lengths
        .iter()
        .zip(last_rows)
        .flat_map(|(&length, is_end)| (0..length).map(move |row| is_end && row + 1 == length));
    let (ends, spans) = (Memory::marks(ends.collect()), found.end_to_end());
    found.sources.push(Source::step("terminals", "truncated", vec![ends], spans));
    found.notes.push(
        "`terminals` mark the ends of trajectories, not of tasks: they are `truncated` here; the action of the last row of an episode \
         leads nowhere and is missing"
            .to_owned(),
    );
    Ok(found)
}

/// Names of OGBench's datasets, and our environments of them.
const ENVIRONMENTS: &[(&str, &str, &str)] = &[
    ("pointmaze-", "swm/OGBPointMaze-v0", "maze_type"),
    ("antmaze-", "swm/OGBAntMaze-v0", "maze_type"),
    ("humanoidmaze-", "swm/OGBHumanoidMaze-v0", "maze_type"),
    ("antsoccer-", "swm/OGBAntSoccer-v0", "maze_type"),
    ("cube-", "swm/OGBCube-v0", "env_type"),
    ("scene-", "swm/OGBScene-v0", ""),
];

/// Which environment of ours the name of a dataset is of.
fn environment(name: &str) -> Option<String> {
    let plain = name.strip_prefix("visual-").unwrap_or(name);
    let (start, env, setting) = ENVIRONMENTS.iter().find(|(start, ..)| plain.starts_with(start))?;
    let kind = plain[start.len()..].split('-').next().unwrap_or_default();
    let settings = match *setting {
        "" => String::new(),
        setting => format!(" with `env_options` {setting}={kind}"),
    };
    Some(format!("its name is that of a dataset of {env}{settings}; the option `env` records that it is"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_to_environments() {
        let of = |name: &str| environment(name).unwrap_or_default();
        assert!(of("cube-single-play-v0").contains("swm/OGBCube-v0 with `env_options` env_type=single"));
        assert!(of("visual-cube-double-noisy-v0-val").contains("env_type=double"));
        assert!(
            of("pointmaze-medium-navigate-v0")
                .contains("swm/OGBPointMaze-v0 with `env_options` maze_type=medium")
        );
        assert_eq!(of("powderworld-easy-play-v0"), "");
    }
}
