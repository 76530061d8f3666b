//! Datasets of every format: opening, joining, reading.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use numpy::{PyArray1, ToPyArray as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use swm::core::evaluate::check_fit;
use swm::core::{Batch, Cancel, Column, EnvConfig, ImageSize, Metadata, Schema, SliceMut};
use swm::data::adapt::{Cached, Columns, Concat, Fit, Resized, Subset, Watched};
use swm::data::stats::{Statistics, StatisticsOptions};
use swm::data::{
    DataError, Dataset, DatasetInfo, Looks, MemoryDataset, OpenOptions, RenderOptions, Rendered, Steps,
    format,
};
use swm::files::remote::Event;

use crate::arrays::{describe, from_array, into_array, lock, step_field};
use crate::errors::{DataFault, OrRaise as _, SwmError, in_words};
use crate::fork::Process;
use crate::integers;
use crate::interrupt::interruptible;
use crate::world::registry;
use crate::writer::recorded;

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Reader>()?;
    m.add_function(wrap_pyfunction!(dataset_formats, m)?)?;
    m.add_function(wrap_pyfunction!(is_remote, m)?)?;
    swm::files::remote::watch(tell);
    m.add_function(wrap_pyfunction!(detect_dataset, m)?)
}

/// How a dataset of another program is opened, from JSON.
pub(crate) fn open_options(options: Option<&str>) -> PyResult<OpenOptions> {
    let read = |text| serde_json::from_str(text).map_err(|error| PyValueError::new_err(error.to_string()));
    options.map_or_else(|| Ok(OpenOptions::default()), read)
}

/// The column that stays dense under a frame skip.
const ACTION: &str = "action";

/// An open dataset.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
pub(crate) struct Reader {
    process: Process,
    info: DatasetInfo,
    dataset: Mutex<Box<dyn Dataset>>,
}

impl Reader {
    fn new(dataset: Box<dyn Dataset>) -> Self {
        Self { process: Process::current(), info: dataset.info().clone(), dataset: Mutex::new(dataset) }
    }

    /// Another handle, for whoever reads beside this one.
    pub(crate) fn share(&self, py: Python<'_>) -> PyResult<Box<dyn Dataset>> {
        self.process.check("this open dataset")?;
        Ok(py.detach(|| lock(&self.dataset).share()))
    }

    /// The dataset that `make` makes of a handle.
    fn derive<D: Dataset + 'static>(
        &self,
        py: Python<'_>,
        make: impl FnOnce(Box<dyn Dataset>) -> Result<D, DataError> + Send,
    ) -> PyResult<Self> {
        self.process.check("this open dataset")?;
        let made = py.detach(|| make(lock(&self.dataset).share()).map(|made| Self::new(Box::new(made))));
        made.or_raise()
    }

    fn field(&self, column: usize) -> PyResult<&swm::core::Field> {
        let fields = self.info.schema.fields();
        fields.get(column).ok_or_else(|| {
            PyValueError::new_err(format!("column {column} of {} does not exist", fields.len()))
        })
    }
}

#[pymethods]
impl Reader {
    /// Opens a file or folder, of the named format or of that which its content tells. `options`: JSON of how a dataset of another
    /// program is opened.
    #[staticmethod]
    #[pyo3(signature = (path, format=None, options=None))]
    fn open(py: Python<'_>, path: PathBuf, format: Option<&str>, options: Option<&str>) -> PyResult<Self> {
        let options = open_options(options)?;
        let opened = py.detach(|| match format {
            // What the content tells may be read as the dataset of another program, and with options.
            Some(name) if format::detect(registry(), &path).is_none_or(|found| found.name != name) => {
                format::by_name(registry(), name)?.open(&path)
            }
            _ => swm::data::open_with(registry(), &path, &options),
        });
        opened.or_raise().map(Self::new)
    }

    /// Episodes in memory: columns `[rows, …]`, end to end, and the rows of every episode.
    #[staticmethod]
    #[pyo3(signature = (name, lengths, columns, metadata=None))]
    fn memory(
        name: &str,
        lengths: Vec<usize>,
        columns: Vec<(String, Bound<'_, PyAny>)>,
        metadata: Option<&str>,
    ) -> PyResult<Self> {
        let rows: usize = lengths.iter().sum();
        let (mut fields, mut values) = (Vec::new(), Vec::new());
        for (name, array) in &columns {
            let (column, shape) = from_array(name, array)?;
            if shape.first() != Some(&rows) {
                let reason = format!("column `{name}` has shape {shape:?}, the episodes have {rows} rows");
                return Err(DataFault::new_err(reason));
            }
            fields.push(step_field(name, &column, &shape));
            values.push(column);
        }
        let schema = Schema::new(fields).or_raise()?;
        let metadata: Option<Metadata> = metadata.map(recorded).transpose()?;
        let mut first = 0;
        let episodes = lengths.iter().map(|&len| {
            let mut batch = Batch::new(schema.clone(), len);
            for (at, column) in values.iter().enumerate() {
                let dim = schema.dim(at);
                let part = column.as_slice().range(first * dim, len * dim);
                assert!(batch.column_mut(at).copy_from(part), "the schema is made of the columns");
            }
            first += len;
            Arc::new(batch)
        });
        let episodes: Vec<_> = episodes.collect();
        let dataset = MemoryDataset::new(name, schema, metadata, episodes).or_raise()?;
        Ok(Self::new(Box::new(dataset)))
    }

    /// Datasets end to end, with the columns that all have.
    #[staticmethod]
    #[expect(clippy::needless_pass_by_value, reason = "what Python hands over")]
    fn concat(py: Python<'_>, readers: Vec<PyRef<'_, Reader>>) -> PyResult<Self> {
        let parts = readers.iter().map(|reader| reader.share(py)).collect::<PyResult<Vec<_>>>()?;
        Concat::new(parts).or_raise().map(|joined| Self::new(Box::new(joined)))
    }

    /// The columns of this dataset, and those of another one that it lacks.
    fn beside(&self, py: Python<'_>, other: PyRef<'_, Reader>) -> PyResult<Self> {
        let other = other.share(py)?;
        self.derive(py, |dataset| Columns::new(dataset, other))
    }

    /// Some of its episodes.
    fn subset(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = integers::episodes)] episodes: Vec<usize>,
    ) -> PyResult<Self> {
        self.derive(py, |dataset| Subset::new(dataset, &episodes))
    }

    /// The same with some columns in memory.
    fn cached(&self, py: Python<'_>, keys: Vec<String>) -> PyResult<Self> {
        let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
        self.derive(py, |dataset| Cached::new(dataset, &keys))
    }

    /// The same with images that are rendered when they are read, `image = (H, W)`; `settings` and `factors` are JSON, and so are `looks`
    /// that are sampled for every clip, and the factors of the `canonical` look, if there are any.
    #[pyo3(signature = (image, settings="{}", factors="{}", looks=None, canonical=None))]
    fn rendered(
        &self,
        py: Python<'_>,
        image: (usize, usize),
        settings: &str,
        factors: &str,
        looks: Option<&str>,
        canonical: Option<&str>,
    ) -> PyResult<Self> {
        let looks = looks.map(serde_json::from_str::<Looks>).transpose();
        let options = RenderOptions::default()
            .image(ImageSize { height: image.0, width: image.1 })
            .settings(json_map(settings)?)
            .factors(self.factor_values(py, factors, "look")?)
            .looks(looks.map_err(|error| DataFault::new_err(error.to_string()))?)
            .canonical(canonical.map(|look| self.factor_values(py, look, "canonical")).transpose()?);
        self.derive(py, |dataset| Rendered::new(dataset, registry(), &options))
    }

    /// Refuses rows of another program that cannot be of this environment; `settings` is JSON.
    fn check_fit(&self, py: Python<'_>, env: &str, settings: &str) -> PyResult<()> {
        let settings =
            serde_json::from_str(settings).map_err(|error| DataFault::new_err(error.to_string()))?;
        let entry = registry().env(env).or_raise()?;
        let spec = entry.make(&EnvConfig { image: None, settings }).or_raise()?.spec().clone();
        let mut dataset = self.share(py)?;
        let fits = py.detach(|| check_fit(dataset.as_mut(), &spec));
        fits.map_err(|error| SwmError::new_err(format!("the dataset {}: {error}", self.info.path.display())))
    }

    /// The same with images of another size, `image = (H, W)`, by area; `fit`: `stretch`, `crop` or `pad`.
    #[pyo3(signature = (image, fit=None))]
    fn resized(&self, py: Python<'_>, image: (usize, usize), fit: Option<&str>) -> PyResult<Self> {
        let fit: Option<Fit> = fit.map(str::parse).transpose().map_err(PyValueError::new_err)?;
        let size = ImageSize::new(image.0, image.1).map_err(PyValueError::new_err)?;
        self.derive(py, |dataset| Resized::new(dataset, size, fit))
    }

    /// The file or folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.info.path.to_path_buf()
    }

    /// The name of its format.
    #[getter]
    fn format(&self) -> &'static str {
        self.info.format
    }

    /// `(name, dtype, shape, kind)` of every column.
    #[getter]
    fn fields(&self) -> Vec<(String, &'static str, Vec<usize>, &'static str)> {
        self.info.schema.fields().iter().map(describe).collect()
    }

    /// Rows of every episode, int64 `(E,)`.
    #[getter]
    fn lengths<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        let lengths: Vec<i64> = self.info.lengths.iter().map(|&len| len as i64).collect();
        lengths.to_pyarray(py)
    }

    /// How it was recorded, as JSON: `[[first episode, metadata], …]`.
    #[getter]
    fn runs(&self) -> PyResult<String> {
        serde_json::to_string(&*self.info.runs).map_err(|error| DataFault::new_err(error.to_string()))
    }

    /// Columns that cannot be represented, with the reason.
    #[getter]
    fn skipped(&self) -> Vec<(String, String)> {
        self.info.skipped.to_vec()
    }

    /// Of a dataset of another program: its columns, and their names in its files.
    #[getter]
    fn mapping(&self) -> BTreeMap<String, String> {
        self.info.mapping.iter().cloned().collect()
    }

    /// What a user of a dataset of another program has to know.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.info.notes.to_vec()
    }

    /// Whether it holds checksums.
    #[getter]
    fn has_checksums(&self) -> bool {
        self.info.has_checksums
    }

    /// Rows `start..stop` of an episode at a stride of `frameskip`, by column, `[rows, …]`; `action` is dense.
    fn slice<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = integers::episode)] episode: usize,
        #[pyo3(from_py_with = integers::start)] start: usize,
        #[pyo3(from_py_with = integers::stop)] stop: usize,
        #[pyo3(from_py_with = integers::frameskip)] frameskip: usize,
        columns: Vec<usize>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let span = stop.saturating_sub(start);
        if frameskip == 0 {
            return Err(PyValueError::new_err("frameskip is 0; use 1 for every row"));
        }
        let mut parts = Vec::with_capacity(columns.len());
        for &column in &columns {
            let field = self.field(column)?;
            let stride = if field.name == ACTION { 1 } else { frameskip };
            parts.push((column, Steps { first: start, count: span.div_ceil(stride), stride }, field));
        }
        let mut dataset = self.share(py)?;
        let read = py.detach(|| {
            let read = parts.iter().map(|&(column, steps, field)| {
                let mut values = Column::zeros(field.dtype, steps.count * field.dim());
                dataset.read_column(column, episode, steps, values.as_slice_mut()).map(|()| values)
            });
            read.collect::<Result<Vec<_>, _>>()
        });
        let arrays = read.or_raise()?.into_iter().zip(&parts);
        arrays
            .map(|(values, (_, steps, field))| into_array(py, values, &with_rows(steps.count, field)))
            .collect()
    }

    /// A whole column, `[rows of all episodes, …]`.
    fn column<'py>(&self, py: Python<'py>, column: usize) -> PyResult<Bound<'py, PyAny>> {
        let field = self.field(column)?;
        let rows: usize = self.info.lengths.iter().sum();
        let mut dataset = self.share(py)?;
        let cancel = Cancel::new();
        let read = interruptible(py, &cancel, || {
            let mut values = Column::zeros(field.dtype, rows * field.dim());
            let mut rest: SliceMut<'_> = values.as_slice_mut();
            for (episode, &count) in self.info.lengths.iter().enumerate() {
                if cancel.is_cancelled() {
                    break;
                }
                let (here, after) = rest.split_at(count * field.dim());
                rest = after;
                dataset.read_column(column, episode, Steps { first: 0, count, stride: 1 }, here)?;
            }
            Ok::<_, DataError>(values)
        })?;
        into_array(py, read.or_raise()?, &with_rows(rows, field))
    }

    /// Single rows, `(episode, row)` each, by column, `[rows, …]`.
    fn gather<'py>(
        &self,
        py: Python<'py>,
        rows: Vec<(usize, usize)>,
        columns: Vec<usize>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let fields = columns.iter().map(|&column| self.field(column)).collect::<PyResult<Vec<_>>>()?;
        let mut dataset = self.share(py)?;
        let read = py.detach(|| {
            let read = columns.iter().zip(&fields).map(|(&column, field)| {
                let mut values = Column::zeros(field.dtype, rows.len() * field.dim());
                let mut rest: SliceMut<'_> = values.as_slice_mut();
                for &(episode, first) in &rows {
                    let (here, after) = rest.split_at(field.dim());
                    rest = after;
                    dataset.read_column(column, episode, Steps { first, count: 1, stride: 1 }, here)?;
                }
                Ok(values)
            });
            read.collect::<Result<Vec<_>, DataError>>()
        });
        let arrays = read.or_raise()?.into_iter().zip(fields);
        arrays.map(|(values, field)| into_array(py, values, &with_rows(rows.len(), field))).collect()
    }

    /// Statistics of columns, as JSON; `keys=None`: all but texts.
    #[pyo3(signature = (keys=None, quantiles=None))]
    fn statistics(
        &self,
        py: Python<'_>,
        keys: Option<Vec<String>>,
        quantiles: Option<Vec<f64>>,
    ) -> PyResult<String> {
        let mut options = StatisticsOptions { keys, ..StatisticsOptions::default() };
        options.quantiles = quantiles.unwrap_or(options.quantiles);
        let (mut dataset, cancel) = self.watched(py)?;
        let computed = interruptible(py, &cancel, || Statistics::compute(&mut dataset, &options))?;
        serde_json::to_string(&computed.or_raise()?).map_err(|error| DataFault::new_err(error.to_string()))
    }

    /// Reads everything and compares it with its checksums: the report as JSON.
    fn verify(&self, py: Python<'_>) -> PyResult<String> {
        let (mut dataset, cancel) = self.watched(py)?;
        let report =
            interruptible(py, &cancel, || swm::data::tools::verify::verify(&mut dataset, &mut |_| {}))?;
        serde_json::to_string(&report).map_err(|error| DataFault::new_err(error.to_string()))
    }
}

/// An object of JSON.
fn json_map(text: &str) -> PyResult<serde_json::Map<String, serde_json::Value>> {
    serde_json::from_str(text).map_err(|error| DataFault::new_err(error.to_string()))
}

impl Reader {
    /// Values of factors of the environment that it was recorded in, from JSON: numbers, or names of colors and choices. They are those of
    /// this argument.
    fn factor_values(
        &self,
        py: Python<'_>,
        text: &str,
        argument: &'static str,
    ) -> PyResult<BTreeMap<String, swm::core::Value>> {
        let dataset = self.share(py)?;
        swm::tasks::request::look_of(dataset.as_ref(), registry(), &json_map(text)?, &mut ())
            .map_err(|error| in_words(error, argument))
    }

    /// A handle that stops reading when the flag is set, and the flag.
    fn watched(&self, py: Python<'_>) -> PyResult<(Watched, Cancel)> {
        let cancel = Cancel::new();
        Ok((Watched::new(self.share(py)?, cancel.clone()), cancel))
    }
}

/// The shape of so many rows of a field.
fn with_rows(rows: usize, field: &swm::core::Field) -> Vec<usize> {
    std::iter::once(rows).chain(field.shape.iter().copied()).collect()
}

/// `(name, description, file extensions)` of every format of this build.
#[pyfunction]
fn dataset_formats() -> Vec<(&'static str, &'static str, Vec<&'static str>)> {
    let formats = registry().all::<swm::data::Format>();
    formats.map(|format| (format.name, format.about, format.extensions.to_vec())).collect()
}

/// Logs what is fetched as a whole, before it is.
fn tell(event: &Event<'_>) {
    if let Event::Begin { name, bytes, done, to } = event {
        let left = bytes.saturating_sub(*done) as f64 / 1e6;
        let text = format!("fetching {name}: {left:.1} MB, to {}", to.display());
        // A logger that fails is no reason to stop.
        let _ = Python::attach(|py| {
            let logger = py.import("logging")?.call_method1("getLogger", ("stable_worldmodel_rs",))?;
            logger.call_method1("warning", ("%s", text)).map(drop)
        });
    }
}

/// Whether a path is the address of a dataset that lies elsewhere.
#[pyfunction]
fn is_remote(path: PathBuf) -> bool {
    swm::files::remote::is_remote(&path)
}

/// The format of an existing file or folder, by its content.
#[pyfunction]
fn detect_dataset(py: Python<'_>, path: PathBuf) -> Option<&'static str> {
    py.detach(|| format::detect(registry(), &path).map(|format| format.name))
}
