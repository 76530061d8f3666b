//! A data format of this crate's own, `jsonl`: a text file with one line per episode, to look at and to read with anything.
//! Large for what it holds, and read whole when it is opened.
//!
//! A line is a JSON object with one key: `columns`, once, at the top; `run`, what is known of the episodes below it; `episode`, the
//! values of each column, row after row. A number that JSON does not have is a text: `"NaN"`. The column `ep_idx`, the episode that a
//! row belongs to, is made up when the file is opened.

use std::fs::{self, File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swm::data::error::FormatError;
use swm::data::recording::{self, EP_IDX, StepIndex, BackendWriter, Session, SessionStart, Backend, Existing};
use swm::data::{DatasetInfo, DataError, Dataset, Format, MemoryDataset, Steps};
use swm_core::{Batch, Column, Dtype, Field, Metadata, Schema, Slice, SliceMut};

/// `jsonl`.
pub const JSONL: Format = Format::new(
    "jsonl",
    "one line of text per episode: to look at",
    |path| begins(path).is_ok_and(|bytes| bytes == BEGIN),
    |path| Ok(Box::new(Lines::open(path)?)),
)
.extensions(&["jsonl"])
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, Jsonl)?)))
.repairer(repair);

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
    info: DatasetInfo,
    episodes: MemoryDataset,
    /// Where the line of the last episode ends, or that of the columns: what a recording that goes on leaves as it is.
    end: u64,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, DataError> {
        let bytes = fs::read(path).map_err(|source| DataError::io(path, "open", source))?;
        let mut runs = Vec::new();
        let mut episodes: Vec<Arc<Batch>> = Vec::new();
        let mut schema = None;
        let (mut at, mut end) = (0, 0);
        for (number, line) in bytes[..whole(&bytes)].split_inclusive(|byte| *byte == b'\n').enumerate() {
            let damaged = |reason: String| DataError::damaged(path, format!("line {}: {reason}", number + 1));
            at += line.len();
            match (serde_json::from_slice(line).map_err(|error| damaged(error.to_string()))?, &schema) {
                (Line::Columns(mut fields), None) => {
                    if let Some(odd) = fields.iter().find(|field| width(field).is_none()) {
                        return Err(damaged(format!("the shape of `{}` is {:?}", odd.name, odd.shape)));
                    }
                    fields.push(Field::step(EP_IDX, Dtype::I32, &[]));
                    schema = Some(Schema::new(fields).map_err(|error| damaged(error.to_string()))?);
                    end = at;
                }
                (Line::Run(metadata), Some(_)) => runs.push((episodes.len() as u64, metadata)),
                (Line::Episode(columns), Some(schema)) => {
                    episodes.push(Arc::new(rows(schema, &columns, episodes.len()).map_err(damaged)?));
                    end = at;
                }
                _ => return Err(damaged("the columns stand in the first line, and there alone".to_owned())),
            }
        }
        let schema = schema.ok_or_else(|| DataError::not_a_dataset(path, "it has no whole line"))?;
        let lengths = episodes.iter().map(|episode| episode.rows()).collect();
        let mut info = DatasetInfo::new(path, JSONL.name, Arc::clone(&schema), lengths);
        info.runs = runs.into();
        let episodes = MemoryDataset::new(&path.to_string_lossy(), schema, None, episodes)?;
        Ok(Self { info, episodes, end: end as u64 })
    }

    /// The columns of the file.
    fn stored(&self) -> &[Field] {
        without_number(self.schema())
    }
}

/// The columns but for `ep_idx`, which is the last.
fn without_number(schema: &Schema) -> &[Field] {
    schema.fields().split_last().map_or(&[], |(_, stored)| stored)
}

/// The bytes of whole lines: what comes after them is an episode that a kill cut off.
fn whole(bytes: &[u8]) -> usize {
    bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1)
}

/// The values per row of a column; `None` if nobody can count them.
fn width(field: &Field) -> Option<usize> {
    field.shape.iter().try_fold(1usize, |width, side| width.checked_mul(*side))
}

/// The table of episode `number`, of what its line says.
fn rows(schema: &Arc<Schema>, columns: &[Vec<Value>], number: usize) -> Result<Batch, String> {
    let fields = without_number(schema);
    if columns.len() != fields.len() {
        return Err(format!("{} columns, not {}", columns.len(), fields.len()));
    }
    // Sizes are compared before anything is made of them: a damaged file may say anything.
    let count = |(field, values): (&Field, &Vec<Value>)| {
        let width = width(field)?;
        let rows = values.len().checked_div(width)?;
        (rows > 0 && rows * width == values.len()).then_some(rows)
    };
    let mut counts = fields.iter().zip(columns).map(count);
    let Some(rows) = counts.next().flatten().filter(|rows| counts.all(|other| other == Some(*rows))) else {
        return Err("its columns are of different lengths, or have no rows".to_owned());
    };
    let mut batch = Batch::new(Arc::clone(schema), rows);
    for (at, (field, values)) in fields.iter().zip(columns).enumerate() {
        let mut column = Column::zeros(field.dtype, 0);
        let is_typed = values.iter().all(|value| push(&mut column, value).is_some());
        if !is_typed || !batch.column_mut(at).copy_from(column.as_slice()) {
            return Err(format!("a value of `{}` is no {}", field.name, field.dtype));
        }
    }
    let number = i32::try_from(number).map_err(|_| "too many episodes".to_owned())?;
    if let SliceMut::I32(out) = batch.column_mut(fields.len()) {
        out.fill(number);
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

impl Dataset for Lines {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        self.episodes.rows(column, episode, steps, out)
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(self.clone())
    }
}

// Recording: one line per episode, safe once it is whole and on the disk.

/// How datasets are stored: what `BackendWriter` asks for.
struct Jsonl;

impl Backend for Jsonl {
    type Session = OpenFile;

    fn name(&self) -> &'static str {
        JSONL.name
    }

    fn is_folder(&self) -> bool {
        false
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        JSONL.open(path)
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

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        recording::remove_file(path)
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<OpenFile, DataError> {
        let &SessionStart { path, existing, fields, metadata, episodes, .. } = start;
        let failed = |source| DataError::io(path, "open", source);
        let (mut lines, mut stored, mut runs) = (Vec::new(), fields.to_vec(), Vec::new());
        let file = if existing == Existing::Continued {
            let old = Lines::open(path)?;
            let first = old.metadata().unwrap_or(metadata);
            recording::check_fit(path, old.stored(), first, fields, metadata)?;
            // What a kill left of a line, and a run that was killed before its first episode.
            cut(path, old.end)?;
            stored = old.stored().to_vec();
            runs = old.info().runs.to_vec();
            OpenOptions::new().append(true).open(path)
        } else {
            lines.push(Line::Columns(stored.clone()));
            File::create(path)
        };
        let mut file = OpenFile { file: file.map_err(failed)?, fields: stored, episode: Vec::new() };
        let last = recording::with_run(&runs, episodes, metadata).pop();
        lines.extend(last.filter(|(first, _)| *first == episodes).map(|(_, run)| Line::Run(run)));
        lines
            .iter()
            .try_for_each(|line| file.write(line))
            .map_err(|error| DataError::record(path, error))?;
        Ok(file)
    }
}

/// A file that is being written.
struct OpenFile {
    file: File,
    /// The columns, in the file's order.
    fields: Vec<Field>,
    /// The values of each column of the episode that is open.
    episode: Vec<Vec<Value>>,
}

impl OpenFile {
    fn write(&mut self, line: &Line) -> Result<(), FormatError> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        self.file.write_all(&text)?;
        Ok(self.file.sync_data()?)
    }
}

impl Session for OpenFile {
    fn append(&mut self, at: StepIndex, rows: &Batch) -> Result<(), FormatError> {
        if at.step == 0 {
            self.episode = vec![Vec::new(); self.fields.len()];
        }
        for (field, column) in self.fields.iter().zip(&mut self.episode) {
            let at = rows.schema().require(&field.name)?;
            column.extend(values(rows.column(at)));
        }
        Ok(())
    }

    fn commit(&mut self, _end: StepIndex) -> Result<(), FormatError> {
        let episode = std::mem::take(&mut self.episode);
        self.write(&Line::Episode(episode))
    }

    fn close(self) -> Result<(), FormatError> {
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
        cut(path, whole as u64)?;
    }
    Ok(vec![format!("cut off an unfinished episode of {} bytes", bytes.len() - whole)])
}

/// Leaves the first bytes of a file.
fn cut(path: &Path, len: u64) -> Result<(), DataError> {
    let cut = || OpenOptions::new().write(true).open(path)?.set_len(len);
    cut().map_err(|source| DataError::io(path, "repair", source))
}
