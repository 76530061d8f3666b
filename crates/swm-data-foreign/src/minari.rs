//! Datasets of Minari in Parquet: a file for each episode.
//!
//! Source of the layout: Minari 0.5.4, `_storages/`. Spaces of several parts are structures, arrays are flat lists whose shapes only the
//! description of the space has, and all columns have as many rows as there are observations: what is no action is 0.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::{Column, Dtype, SliceMut};
use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, Steps, copy_rows};
use swm_data::error::{At as _, DataError, FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_data_lerobot::Table;

use super::array::{Array, Scratch, Shared, new_key, widen};
use super::dataset::Span;
use super::encoded;
use super::found::Found;
use super::grouped::{about_minari, json_at, json_in, name_in_minari};
use super::natural;

const NAME: &str = "minari";
const ABOUT: &str = "metadata.json";
const PART: &str = "part-0.parquet";
/// Episodes, at most.
const MAX_EPISODES: usize = 1 << 20;
/// The most values of a row.
const MAX_DIM: usize = 1 << 28;

/// The folder of the episodes.
fn folder(path: &Path) -> Option<PathBuf> {
    let places = [path.join("data"), path.to_owned()];
    places.into_iter().find(|folder| json_at(&folder.join(ABOUT))["data_format"] == "parquet")
}

pub(super) fn detect(path: &Path) -> bool {
    path.is_dir() && folder(path).is_some()
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let damaged = |error: FormatError| DataError::damaged(path, error);
    let folder = folder(path).ok_or_else(|| damaged(invalid(format!("its `{ABOUT}` names no format"))))?;
    let found = find(&folder).map_err(damaged)?;
    found.open(path, NAME, options, &[])
}

/// The files of all episodes, in the order of their numbers.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = folder.read_dir()?.flatten().take(MAX_EPISODES + 1);
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit()))
        .collect();
    if names.len() > MAX_EPISODES {
        return Err(invalid(format!("it has more than {MAX_EPISODES} episodes")));
    }
    names.sort_by_key(|name| natural(name));
    Ok(names.iter().map(|name| folder.join(name).join(PART)).collect())
}

fn find(folder: &Path) -> Result<Found> {
    let about = json_at(&folder.join(ABOUT));
    let spaces = [("observations", "observation_space"), ("actions", "action_space")]
        .map(|(column, space)| (column, json_in(about[space].as_str().map(str::to_owned))));
    let files = files(folder)?;
    let expected = about["total_episodes"].as_u64().unwrap_or(files.len() as u64);
    if expected != files.len() as u64 {
        return Err(invalid(format!(
            "`{ABOUT}` tells of {expected} episodes, and {} are there",
            files.len()
        )));
    }
    let mut found = Found::default();
    let mut columns: Vec<Columns> = Vec::new();
    for (file, path) in files.iter().enumerate() {
        let table = Table::open(path)?;
        found.lengths.push(table.rows());
        add_columns(&mut columns, file, table.leaves()).at(path.display())?;
    }
    let mut scratch = Scratch::default();
    for Columns { path, leaf, is_bytes, files: own } in columns {
        let root = path.split('/').next().unwrap_or_default();
        let space =
            spaces.iter().find(|(column, _)| *column == root).and_then(|(_, space)| below(space, &path));
        let kind = Table::open(&files[own[0]]).and_then(|model| Kind::of(&model, leaf, is_bytes, space));
        let kind = match kind {
            Ok(kind) => kind,
            Err(error) if error.is_unsupported() => {
                found.skipped.push((name_in_minari(&path), error.to_string()));
                continue;
            }
            Err(error) => return Err(error.at(format_args!("column `{path}`"))),
        };
        // What belongs to steps has one row less than there are observations.
        let is_of_steps = matches!(root, "actions" | "rewards" | "terminations" | "truncations");
        let array = |file: usize| -> Shared {
            let (kind, name, rows) = (kind.clone(), path.clone(), found.lengths[file]);
            Arc::new(Leaf { path: files[file].clone(), name, leaf, rows, kind, key: new_key() })
        };
        let mut arrays = vec![None; files.len()];
        own.iter().for_each(|&file| arrays[file] = Some(array(file)));
        let span = |(array, &rows): (usize, &usize)| {
            let count = rows.saturating_sub(usize::from(is_of_steps));
            Span { array, first: 0, count, tail: None }
        };
        let spans: Vec<Span> = found.lengths.iter().enumerate().map(span).collect();
        found.add_partial(&path, &name_in_minari(&path), arrays, &spans);
    }
    // Whether all can be read is seen in the first row of the first episode that has them.
    for source in &found.sources {
        if let Some(array) = source.arrays.first().filter(|array| array.rows() > 0) {
            super::array::values(array.as_ref(), Steps { first: 0, count: 1, stride: 1 }, &mut scratch)
                .at(&source.old)?;
        }
    }
    about_minari(&folder.join(ABOUT), &mut found);
    Ok(found)
}

/// A column of some files.
struct Columns {
    path: String,
    /// Where it is in the first of them, and whether it holds bytes there.
    leaf: usize,
    is_bytes: bool,
    files: Vec<usize>,
}

/// Adds the columns of a file, which has actions.
fn add_columns(columns: &mut Vec<Columns>, file: usize, leaves: Vec<(String, bool)>) -> Result<()> {
    if !leaves.iter().any(|(path, _)| path.split('/').next() == Some("actions")) {
        return Err(missing("it has no column `actions`"));
    }
    for (leaf, (path, is_bytes)) in leaves.into_iter().enumerate() {
        // Files have the same columns in the same order, nearly always.
        let is_it = |columns: &&mut Columns| columns.path == path;
        let at = match columns.get(leaf).is_some_and(|columns| columns.path == path) {
            true => columns.get_mut(leaf),
            false => columns.iter_mut().find(is_it),
        };
        match at {
            Some(columns) if columns.files.last() == Some(&file) => {}
            Some(columns) => columns.files.push(file),
            None => columns.push(Columns { path, leaf, is_bytes, files: vec![file] }),
        }
    }
    Ok(())
}

/// The space of a column, of that of its root.
fn below<'a>(space: &'a Json, path: &str) -> Option<&'a Json> {
    path.split('/').skip(1).try_fold(space, |space, part| {
        let parts = &space["subspaces"];
        match parts.as_array() {
            Some(parts) => parts.get(part.parse::<usize>().ok()?),
            None => parts.get(part),
        }
    })
}

/// The shape of the values of a space, where its description has one.
fn sizes(space: &Json) -> Option<Vec<usize>> {
    let size = |size: &Json| size.as_u64().and_then(|size| usize::try_from(size).ok());
    // One `n` is that of the only axis of `MultiBinary`; that of `Discrete` counts its values.
    let listed = match space["type"].as_str() {
        Some("MultiBinary") => &space["n"],
        _ => &space["shape"],
    };
    if let Some(mut counts) = space["nvec"].as_array() {
        let mut shape = vec![counts.len()];
        while let Some(inner) = counts.first().and_then(Json::as_array) {
            shape.push(inner.len());
            counts = inner;
        }
        return Some(shape);
    }
    match listed.as_array() {
        Some(all) => all.iter().map(size).collect(),
        None => size(listed).map(|one| vec![one]),
    }
}

/// What the rows of a column are.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    Values {
        dtype: Dtype,
        shape: Vec<usize>,
    },
    /// Encoded images, or the bytes of images.
    Images([usize; 3]),
}

impl Kind {
    fn of(table: &Table, leaf: usize, is_bytes: bool, space: Option<&Json>) -> Result<Self> {
        let sizes = space.and_then(sizes);
        let dim = |shape: &[usize]| {
            shape.iter().try_fold(1usize, |dim, &size| dim.checked_mul(size)).filter(|&dim| dim <= MAX_DIM)
        };
        let shape = sizes.filter(|shape| dim(shape).is_some() && !shape.contains(&0));
        if is_bytes {
            return match shape.as_deref() {
                Some(&[height, width, colors @ (1 | 3)]) => Ok(Self::Images([height, width, colors])),
                Some(shape) => Err(unsupported(format!(
                    "its images have the shape {shape:?}, and are read with 1 or 3 colors"
                ))),
                None => Err(unsupported("its bytes are of no space that the metadata describes")),
            };
        }
        let values = table.leaf(leaf)?;
        let (dtype, rows) = (values.dtype(), table.rows().max(1));
        let width = values.len() / rows;
        let is_list = values.len() != rows || shape.as_ref().is_some_and(|shape| !shape.is_empty());
        let shape = match shape {
            Some(shape) if dim(&shape) == Some(width) => shape,
            _ if is_list => vec![width],
            _ => Vec::new(),
        };
        let is_u8 = space.is_some_and(|space| space["dtype"] == "uint8") && dtype == Dtype::I32;
        Ok(Self::Values { dtype: if is_u8 { Dtype::U8 } else { dtype }, shape })
    }
}

/// A column of one episode.
#[derive(Debug)]
struct Leaf {
    path: PathBuf,
    /// Its path in the file.
    name: String,
    leaf: usize,
    rows: usize,
    kind: Kind,
    key: usize,
}

impl Leaf {
    /// The file; its column is where it is in the first one.
    fn table(&self) -> Result<(Table, usize)> {
        let table = Table::open(&self.path)?;
        let leaves = table.leaves();
        let is_it = |at: usize| leaves.get(at).is_some_and(|(name, _)| *name == self.name);
        let leaf = if is_it(self.leaf) { Some(self.leaf) } else { (0..leaves.len()).find(|&at| is_it(at)) };
        let leaf = leaf.ok_or_else(|| invalid(format!("it has no column `{}`", self.name)))?;
        match table.rows() == self.rows {
            true => Ok((table, leaf)),
            false => Err(invalid(format!(
                "it has {} rows, and had {} when it was opened",
                table.rows(),
                self.rows
            ))),
        }
    }

    fn values(&self) -> Result<Column> {
        let (table, leaf) = self.table()?;
        let column = match table.leaf(leaf)? {
            Column::I32(values) if self.dtype() == Dtype::U8 => {
                let byte =
                    |value| u8::try_from(value).map_err(|_| invalid(format!("the value {value} is no byte")));
                Column::U8(values.into_iter().map(byte).collect::<Result<_>>()?)
            }
            column => column,
        };
        if column.len() != self.rows * self.dim() {
            let (found, rows, shape) = (column.len(), self.rows, self.shape());
            return Err(invalid(format!(
                "it holds {found} values, and {rows} rows of {shape:?} were expected"
            )));
        }
        if column.dtype() == self.dtype() {
            return Ok(column);
        }
        let mut wider = Column::zeros(self.dtype(), column.len());
        widen(&column, wider.as_slice_mut())?;
        Ok(wider)
    }
}

impl Array for Leaf {
    fn dtype(&self) -> Dtype {
        match &self.kind {
            Kind::Values { dtype, .. } => *dtype,
            Kind::Images(_) => Dtype::U8,
        }
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn shape(&self) -> &[usize] {
        match &self.kind {
            Kind::Values { shape, .. } => shape,
            Kind::Images(shape) => shape,
        }
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let place = || format!("{}, `{}`", self.path.display(), self.name);
        let Kind::Images(shape) = self.kind else {
            let make = |_: &mut Scratch| {
                let column = self.values()?;
                let bytes = column.len() * 8;
                Ok((column, bytes))
            };
            let column = scratch.part((self.key, 0), make).at(place())?;
            copy_rows(column.as_slice(), self.dim(), rows, out);
            return Ok(());
        };
        let SliceMut::U8(out) = out else { return Err(wrong_type("images hold bytes")) };
        let make = |_: &mut Scratch| {
            let (table, leaf) = self.table()?;
            let images = table.bytes(leaf)?;
            let bytes = images.iter().map(Vec::len).sum();
            Ok((images, bytes))
        };
        let images: &mut Vec<Vec<u8>> = scratch.part((self.key, 0), make).at(place())?;
        for (index, out) in out.chunks_exact_mut(self.dim()).enumerate() {
            let row = rows.first + index * rows.stride;
            let image =
                images.get(row).ok_or_else(|| invalid(format!("row {row} has no image")).at(place()))?;
            match &image[..] {
                [0xff, 0xd8, ..] | [0x89, b'P', b'N', b'G', ..] => {
                    encoded::decode(image, shape, out).at(place())?;
                }
                image if image.len() == out.len() => out.copy_from_slice(image),
                image => {
                    let reason =
                        format!("row {row} has {} bytes, which are no image of {shape:?}", image.len());
                    return Err(invalid(reason).at(place()));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::sizes;

    #[test]
    fn spaces_have_their_shapes() {
        for (space, shape) in [
            (json!({"type": "Box", "shape": [4, 2]}), Some(vec![4, 2])),
            (json!({"type": "Discrete", "n": 3}), None),
            (json!({"type": "MultiBinary", "n": 1}), Some(vec![1])),
            (json!({"type": "MultiBinary", "n": [2, 3]}), Some(vec![2, 3])),
            (json!({"type": "MultiDiscrete", "nvec": [3, 4, 5]}), Some(vec![3])),
            (json!({"type": "MultiDiscrete", "nvec": [[2, 3, 4], [4, 5, 6]]}), Some(vec![2, 3])),
            (json!({"type": "Box", "shape": [-1]}), None),
        ] {
            assert_eq!(sizes(&space), shape, "{space}");
        }
    }
}
