//! Writing datasets: whole episodes from Python.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::{Map, Value as Json};
use swm::core::error::{BoxError, did_you_mean, nearest};
use swm::core::{Batch, Column, Field, FieldKind, Metadata, RecordingPart, Schema, settings};
use swm::data::dataset::{DatasetWriter, WriteOptions};
use swm::data::{DataError, LastRow, WriteMode, format};

use crate::arrays::{from_array, lock, step_field};
use crate::errors::{DataFault, OrRaise as _, SwmError};
use crate::fork::Process;
use crate::integers;
use crate::world::registry;

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    LOADED.get_or_init(Process::current);
    m.add_class::<EpisodeWriter>()
}

/// The process in which this module was loaded. Forks of it have none of the threads that encode images.
static LOADED: OnceLock<Process> = OnceLock::new();

/// Refuses what would wait for threads that a fork does not have; only HDF5 is written without them.
pub(crate) fn check_threads(format: Option<&str>) -> PyResult<()> {
    match LOADED.get() {
        Some(loaded) if !loaded.is_current() && format != Some("hdf5") => Err(SwmError::new_err(
            "this process is a fork, which can write only HDF5; start it with the method `spawn` or `forkserver`",
        )),
        _ => Ok(()),
    }
}

/// How a dataset is written.
fn options(
    mode: &str,
    quality: Option<u8>,
    fps: Option<f64>,
    key_frame_period: Option<u32>,
    last_row: Option<&str>,
) -> PyResult<WriteOptions> {
    let mode: WriteMode = mode.parse().map_err(PyValueError::new_err)?;
    let options = WriteOptions::default().mode(mode).quality(quality);
    let last_row: Option<LastRow> = last_row.map(str::parse).transpose().map_err(PyValueError::new_err)?;
    Ok(options.frames_per_second(fps).key_frame_period(key_frame_period).last_row(last_row))
}

/// The record of a recording from JSON: what it leaves out is unknown.
pub(crate) fn recorded(json: &str) -> PyResult<Metadata> {
    let wrong = |reason: String| DataFault::new_err(format!("metadata: {reason}"));
    let given: Map<String, Json> =
        serde_json::from_str(json).map_err(|error| wrong(format!("give a dict: {error}")))?;
    let object = |metadata: &Metadata| match serde_json::to_value(metadata) {
        Ok(Json::Object(object)) => object,
        _ => Map::new(),
    };
    let mut all = object(&Metadata::unknown());
    let part = Some(RecordingPart { shard: 1, of: 1, first: 0, end: 0, total: 0 });
    let made_from = [(String::new(), String::new())].into();
    let (renderer, rows_per_second, checkpoints) = (Some(String::new()), Some(1.0), Some(1));
    let full = Metadata { renderer, rows_per_second, checkpoints, part, made_from, ..Metadata::unknown() };
    let known = object(&full);
    if let Some(name) = given.keys().find(|name| !known.contains_key(*name)) {
        let names: Vec<&str> = known.keys().map(String::as_str).collect();
        let near = nearest(name, names.iter().copied());
        let meant = did_you_mean(near.as_deref());
        return Err(wrong(format!("there is no `{name}`{meant}; it has {}", names.join(", "))));
    }
    all.extend(given);
    settings::read(&all).map_err(|error| wrong(format!("`{}`: {}", error.name, error.reason)))
}

/// A dataset that whole episodes are written to. The first one decides on its columns.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
pub(crate) struct EpisodeWriter {
    process: Process,
    path: PathBuf,
    metadata: Metadata,
    open: Mutex<Open>,
}

struct Open {
    /// `None` once it is finished.
    writer: Option<Box<dyn DatasetWriter>>,
    schema: Option<Arc<Schema>>,
}

#[pymethods]
impl EpisodeWriter {
    /// Takes the file for itself. `metadata`, JSON, says how the episodes were made.
    #[new]
    #[pyo3(signature = (path, format=None, mode="append", metadata=None, quality=None, fps=None, key_frame_period=None, last_row=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        format: Option<&str>,
        mode: &str,
        metadata: Option<&str>,
        quality: Option<u8>,
        fps: Option<f64>,
        #[pyo3(from_py_with = integers::key_frame_period)] key_frame_period: Option<u32>,
        last_row: Option<&str>,
    ) -> PyResult<Self> {
        check_threads(format)?;
        let options = options(mode, quality, fps, key_frame_period, last_row)?;
        let metadata = match metadata {
            Some(json) => recorded(json)?,
            None => Metadata::unknown(),
        };
        let writer = py.detach(|| format::create_in(registry(), &path, &options, format)).or_raise()?;
        let open = Mutex::new(Open { writer: Some(writer), schema: None });
        Ok(Self { process: Process::current(), path, metadata, open })
    }

    /// Appends an episode: columns `[T, …]`, of which `constant` do not change in an episode. When it returns, a crash
    /// cannot lose the episode.
    #[pyo3(signature = (columns, constant=Vec::new()))]
    #[expect(clippy::needless_pass_by_value, reason = "what Python hands over")]
    fn write_episode(
        &self,
        py: Python<'_>,
        columns: Vec<(String, Bound<'_, PyAny>)>,
        constant: Vec<String>,
    ) -> PyResult<()> {
        self.process.check("this dataset writer")?;
        let (mut fields, mut values, mut rows) = (Vec::new(), Vec::new(), None);
        for (name, array) in &columns {
            let (column, shape) = from_array(name, array)?;
            let len = shape.first().copied().unwrap_or(0);
            if *rows.get_or_insert(len) != len {
                let reason = format!("column `{name}` has {len} rows, the others have {}", rows.unwrap_or(0));
                return Err(DataFault::new_err(reason));
            }
            let kind = if constant.contains(name) { FieldKind::Episode } else { FieldKind::Step };
            fields.push(Field { kind, ..step_field(name, &column, &shape) });
            values.push(column);
        }
        let schema = Schema::new(fields).or_raise()?;
        py.detach(|| self.write(&schema, &values, rows.unwrap_or(0))).or_raise()
    }

    /// Ends the dataset cleanly.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        self.process.check("this dataset writer")?;
        let finished = py.detach(|| {
            let mut open = lock(&self.open);
            let begun = open.schema.is_some();
            match open.writer.take() {
                Some(mut writer) if begun => writer.finish().map_err(|error| failed(&self.path, error)),
                _ => Ok(()),
            }
        });
        finished.or_raise()
    }
}

impl EpisodeWriter {
    fn write(&self, schema: &Arc<Schema>, values: &[Column], rows: usize) -> Result<(), DataError> {
        let mut open = lock(&self.open);
        let Open { writer: Some(writer), schema: begun } = &mut *open else {
            return Err(DataError::record(&self.path, "it is finished; open it again to append"));
        };
        if rows == 0 {
            // Before a dataset that is replaced is gone.
            return Err(DataError::record(&self.path, "an episode without rows"));
        }
        match begun {
            None => {
                writer.begin(schema, &self.metadata).map_err(|error| failed(&self.path, error))?;
                *begun = Some(schema.clone());
            }
            Some(begun) if begun == schema => {}
            Some(begun) => {
                let differs = |field: &&Field| !begun.fields().contains(field);
                let told = match schema.fields().iter().find(differs) {
                    Some(Field { name, dtype, shape, .. }) => {
                        match begun.fields().iter().find(|field| field.name == *name) {
                            Some(before) => format!(
                                "column `{name}` is {dtype} {shape:?} a step, and {} {:?} in the episodes before it; give it as before",
                                before.dtype, before.shape
                            ),
                            None => format!("column `{name}` is not in the episodes before it; leave it out"),
                        }
                    }
                    None => {
                        "it has other columns than the episodes before it, or in another order".to_owned()
                    }
                };
                return Err(DataError::record(&self.path, format!("schema mismatch: {told}")));
            }
        }
        let mut batch = Batch::new(schema.clone(), rows);
        for (at, column) in values.iter().enumerate() {
            assert!(batch.column_mut(at).copy_from(column.as_slice()), "the schema is made of the columns");
        }
        writer.write_episode(&batch).map_err(|error| failed(&self.path, error))
    }
}

/// The error of a sink, which is almost always one of datasets.
fn failed(path: &Path, error: BoxError) -> DataError {
    match error.downcast::<DataError>() {
        Ok(error) => *error,
        Err(error) => DataError::record(path, error.to_string()),
    }
}
