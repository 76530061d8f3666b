//! A data format of this crate's own, `jsonl`: a text file with one line per episode, to look at and to read with anything.
//! Large for what it holds, and read whole when it is opened.
//!
//! A line is a JSON object with one key: `columns`, once, at the top; `run`, what is known of the episodes below it; `episode`, the
//! values of each column, row after row. A number that JSON does not have is a text: `"NaN"`.

use std::fs::{self, File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swm::data::recording::{self, Place, Recorder, Recording, Start, Storage, There};
use swm::data::{DataError, Dataset, Format, MemoryDataset, Steps};
use swm_core::error::BoxError;
use swm_core::{Batch, Column, EpisodeSource, Field, Metadata, Schema, Slice, SliceMut};

/// `swm_data::format::register(&JSONL)` makes it known.
pub static JSONL: Format = Format {
    name: "jsonl",
    extensions: &["jsonl"],
    about: "one line of text per episode: to look at",
    detect: |path| begins(path).is_ok_and(|bytes| bytes == BEGIN),
    open: |path| Ok(Box::new(Lines::open(path)?)),
    create: |path, options| Ok(Box::new(Recorder::new(path, options, Jsonl)?)),
    repair,
};

/// What every file begins with.
const BEGIN: &[u8] = b"{\"columns\":";

/// The first bytes of a file, as many as `BEGIN` has.
fn begins(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(BEGIN.len() as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A line of the file.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Line {
    Columns(Vec<Field>),
    Run(Metadata),
    Episode(Vec<Vec<Value>>),
}

// What a file holds.

/// An open dataset: its episodes in memory, and what is known of them.
#[derive(Clone)]
struct Lines {
    path: PathBuf,
    runs: Vec<(u64, Metadata)>,
    episodes: MemoryDataset,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, DataError> {
        let bytes = fs::read(path).map_err(|source| DataError::io(path, "open", source))?;
        let mut runs = Vec::new();
        let mut episodes: Vec<Arc<Batch>> = Vec::new();
        let mut schema = None;
        let damaged = |number: usize, reason: String| {
            DataError::damaged(path, format!("line {}: {reason}", number + 1))
        };
        for (number, line) in bytes[..whole(&bytes)].split_inclusive(|byte| *byte == b'\n').enumerate() {
            let line = serde_json::from_slice(line).map_err(|error| damaged(number, error.to_string()))?;
            match (line, &schema) {
                (Line::Columns(fields), None) => {
                    schema = Some(Schema::new(fields).map_err(|error| damaged(number, error.to_string()))?);
                }
                (Line::Run(metadata), Some(_)) => runs.push((episodes.len() as u64, metadata)),
                (Line::Episode(columns), Some(schema)) => {
                    let rows = batch(schema, &columns).map_err(|reason| damaged(number, reason))?;
                    episodes.push(Arc::new(rows));
                }
                _ => {
                    return Err(damaged(
                        number,
                        "the columns stand in the first line, and there alone".into(),
                    ));
                }
            }
        }
        let schema = schema.ok_or_else(|| DataError::not_a_dataset(path, "it has no whole line"))?;
        let episodes = MemoryDataset::new(&path.to_string_lossy(), schema, None, episodes)?;
        Ok(Self { path: path.to_owned(), runs, episodes })
    }
}

/// The bytes of whole lines: what comes after them is an episode that a kill cut off.
fn whole(bytes: &[u8]) -> usize {
    bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1)
}

/// The rows of an episode.
fn batch(schema: &Arc<Schema>, columns: &[Vec<Value>]) -> Result<Batch, String> {
    let fields = schema.fields();
    if columns.len() != fields.len() || fields.is_empty() {
        return Err(format!("{} columns, not {}", columns.len(), fields.len()));
    }
    // Sizes are compared before anything is made of them: a damaged file may say anything.
    let rows = |field: &Field, values: &[Value]| {
        let width = field.shape.iter().try_fold(1usize, |width, side| width.checked_mul(*side))?;
        let rows = values.len().checked_div(width)?;
        (rows * width == values.len()).then_some(rows)
    };
    let counts: Vec<_> = fields.iter().zip(columns).map(|(field, values)| rows(field, values)).collect();
    let Some(rows) = counts[0].filter(|rows| counts.iter().all(|other| *other == Some(*rows))) else {
        return Err("its columns differ in their rows".into());
    };
    let mut batch = Batch::new(Arc::clone(schema), rows);
    for (at, (field, values)) in fields.iter().zip(columns).enumerate() {
        let mut column = Column::zeros(field.dtype, 0);
        let is_typed = values.iter().all(|value| push(&mut column, value).is_some());
        if !is_typed || !batch.column_mut(at).copy_from(column.as_slice()) {
            return Err(format!("a value of `{}` is no {}", field.name, field.dtype));
        }
    }
    Ok(batch)
}

fn push(column: &mut Column, value: &Value) -> Option<()> {
    let number = || value.as_f64().or_else(|| value.as_str()?.parse().ok());
    match column {
        Column::Bool(values) => values.push(value.as_bool()?),
        Column::U8(values) => values.push(value.as_u64()?.try_into().ok()?),
        Column::I32(values) => values.push(value.as_i64()?.try_into().ok()?),
        Column::I64(values) => values.push(value.as_i64()?),
        Column::F32(values) => values.push(number()? as f32),
        Column::F64(values) => values.push(number()?),
        Column::Str(values) => values.push(value.as_str()?.to_owned()),
    }
    Some(())
}

fn values(slice: Slice<'_>) -> Vec<Value> {
    let number = |value: f64| if value.is_finite() { json!(value) } else { json!(value.to_string()) };
    match slice {
        Slice::Bool(values) => values.iter().map(|value| json!(value)).collect(),
        Slice::U8(values) => values.iter().map(|value| json!(value)).collect(),
        Slice::I32(values) => values.iter().map(|value| json!(value)).collect(),
        Slice::I64(values) => values.iter().map(|value| json!(value)).collect(),
        Slice::F32(values) => values.iter().map(|&value| number(value.into())).collect(),
        Slice::F64(values) => values.iter().map(|&value| number(value)).collect(),
        Slice::Str(values) => values.iter().map(|value| json!(value)).collect(),
    }
}

// Reading: what is in memory already.

impl EpisodeSource for Lines {
    fn schema(&self) -> &Arc<Schema> {
        self.episodes.schema()
    }
    fn num_episodes(&self) -> usize {
        self.episodes.num_episodes()
    }
    fn episode_len(&self, episode: usize) -> usize {
        self.episodes.episode_len(episode)
    }
    fn metadata(&self) -> Option<&Metadata> {
        self.runs.first().map(|(_, metadata)| metadata)
    }
    fn read(&mut self, episode: usize, rows: Range<usize>, out: &mut Batch) -> Result<(), BoxError> {
        self.episodes.read(episode, rows, out)
    }
}

impl Dataset for Lines {
    fn path(&self) -> &Path {
        &self.path
    }
    fn format(&self) -> &'static str {
        JSONL.name
    }
    fn read_column(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        self.episodes.read_column(column, episode, steps, out)
    }
    fn share(&self) -> Box<dyn Dataset> {
        Box::new(self.clone())
    }
    fn runs(&self) -> &[(u64, Metadata)] {
        &self.runs
    }
}

// Recording: one line per episode, safe once it is whole and on the disk.

/// How datasets are stored: what `Recorder` asks for.
struct Jsonl;

impl Storage for Jsonl {
    type Recording = OpenFile;

    fn name(&self) -> &'static str {
        JSONL.name
    }

    fn is_folder(&self) -> bool {
        false
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        (JSONL.open)(path)
    }

    /// Also where a recording was killed amid its first line.
    fn is_new(&self, path: &Path) -> Result<bool, DataError> {
        let Ok(bytes) = fs::read(path) else { return Ok(!path.exists()) };
        let is_ours = bytes.starts_with(BEGIN) || BEGIN.starts_with(&bytes);
        Ok(is_ours && whole(&bytes) == 0)
    }

    fn refuses(&self, _name: &str) -> Option<&'static str> {
        None
    }

    fn start(&self, start: &Start<'_>) -> Result<OpenFile, DataError> {
        let &Start { path, there, fields, metadata, episodes, .. } = start;
        let mut runs = Vec::new();
        let mut lines = vec![Line::Columns(fields.to_vec())];
        if there == There::Continued {
            let old = Lines::open(path)?;
            let first = old.metadata().unwrap_or(metadata);
            recording::check_fit(path, old.schema().fields(), first, fields, metadata)?;
            repair(path, true)?;
            runs = old.runs;
            lines.clear();
        }
        let after = recording::with_run(&runs, episodes, metadata);
        if after.len() > runs.len() {
            lines.push(Line::Run(metadata.clone()));
        }
        let failed = |reason: String| DataError::record(path, reason);
        let mut options = OpenOptions::new();
        match there {
            There::Continued => options.append(true),
            There::Nothing | There::Replaced => options.create(true).write(true).truncate(true),
        };
        let file = options.open(path).map_err(|source| DataError::io(path, "open", source))?;
        let mut file = OpenFile { file, fields: fields.to_vec(), episode: Vec::new() };
        lines.iter().try_for_each(|line| file.write(line)).map_err(failed)?;
        Ok(file)
    }
}

/// A file that is being written.
struct OpenFile {
    file: File,
    fields: Vec<Field>,
    /// The values of each column of the episode that is open.
    episode: Vec<Vec<Value>>,
}

impl OpenFile {
    fn write(&mut self, line: &Line) -> Result<(), String> {
        let mut text = serde_json::to_vec(line).map_err(|error| error.to_string())?;
        text.push(b'\n');
        self.file.write_all(&text).and_then(|()| self.file.sync_data()).map_err(|error| error.to_string())
    }
}

impl Recording for OpenFile {
    fn append(&mut self, at: Place, rows: &Batch) -> Result<(), String> {
        if at.row == 0 {
            self.episode = vec![Vec::new(); self.fields.len()];
        }
        for (field, column) in self.fields.iter().zip(&mut self.episode) {
            let at = rows.schema().require(&field.name).map_err(|error| error.to_string())?;
            column.extend(values(rows.column(at)));
        }
        Ok(())
    }

    fn announce(&mut self, _end: Place) -> Result<(), String> {
        let episode = std::mem::take(&mut self.episode);
        self.write(&Line::Episode(episode))
    }

    fn close(self) -> Result<(), String> {
        Ok(())
    }
}

/// Cuts off what a kill left of a line.
fn repair(path: &Path, is_told: bool) -> Result<Vec<String>, DataError> {
    let bytes = fs::read(path).map_err(|source| DataError::io(path, "open", source))?;
    let whole = whole(&bytes);
    if whole == bytes.len() {
        return Ok(Vec::new());
    }
    if is_told {
        let cut = || OpenOptions::new().write(true).open(path)?.set_len(whole as u64);
        cut().map_err(|source| DataError::io(path, "mend", source))?;
    }
    Ok(vec![format!("cut off an unfinished episode of {} bytes", bytes.len() - whole)])
}
