//! Clips by their number, and batches of them for training.

use std::mem;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use swm::core::{Batch, Cancel, ImageSize, Schema};
use swm::data::adapt::Watched;
use swm::data::loader::{Batches, Clips, GoalOptions, GoalWeights, Images, Position, Rewards};
use swm::data::{BatchOptions, CacheOptions, ClipOptions, Loader};

use crate::arrays::{describe, lock};
use crate::dataset::Reader;
use crate::errors::OrRaise as _;
use crate::fork::Process;
use crate::integers;
use crate::interrupt::interruptible;
use crate::memory::tables::{AnyTable, ForeignTable, Pool, lend};

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<ClipReader>()?;
    m.add_class::<BatchStream>()
}

/// `(weights of random, geometric, uniform and current goals, gamma, offset, keys, seed)`.
type Goals = ((f64, f64, f64, f64), f64, Option<usize>, Option<Vec<String>>, u64);

/// Clips of a dataset.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
pub(crate) struct ClipReader {
    process: Process,
    loader: Loader,
    names: Arc<[Py<PyString>]>,
    pool: Arc<Pool>,
}

#[pymethods]
impl ClipReader {
    /// Clips of `num_steps` rows at a distance of `frameskip`. `image = (H, W)` resizes images; with `action_rewards`,
    /// rewards are beside the actions that earn them; with `float32`, columns of f64 are f32. With `cache_limit`, images are
    /// decoded once into files of at most so many bytes.
    #[new]
    #[pyo3(signature = (
        reader, num_steps=1, frameskip=1, keys=None, channels_first=true, image=None, paper=false, threads=None,
        goals=None, action_rewards=false, float32=false, cache_limit=None,
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        reader: PyRef<'_, Reader>,
        #[pyo3(from_py_with = integers::num_steps)] num_steps: usize,
        #[pyo3(from_py_with = integers::frameskip)] frameskip: usize,
        keys: Option<Vec<String>>,
        channels_first: bool,
        image: Option<(usize, usize)>,
        paper: bool,
        #[pyo3(from_py_with = integers::threads)] threads: Option<usize>,
        goals: Option<Goals>,
        action_rewards: bool,
        float32: bool,
        cache_limit: Option<u64>,
    ) -> PyResult<Self> {
        let goals = goals.map(|((random, geometric, uniform, current), gamma, offset, keys, seed)| {
            let weights = GoalWeights { random, geometric, uniform, current };
            GoalOptions::default().weights(weights).gamma(gamma).offset(offset).keys(keys).seed(seed)
        });
        let options = ClipOptions::default()
            .num_steps(num_steps)
            .frameskip(frameskip)
            .keys(keys)
            .images(if channels_first { Images::ChannelsFirst } else { Images::ChannelsLast })
            .image(image.map(|(height, width)| ImageSize { height, width }))
            .clips(if paper { Clips::Paper } else { Clips::Every })
            .threads(threads)
            .rewards(if action_rewards { Rewards::OfActions } else { Rewards::Recorded })
            .float32(float32)
            .goals(goals)
            .cache(cache_limit.map(|limit| CacheOptions::default().limit(limit)));
        let (dataset, cancel) = (reader.share(py)?, Cancel::new());
        let loader = match cache_limit {
            None => Loader::new(dataset, &options).or_raise()?,
            // Decoding takes long.
            Some(_) => {
                let watched = Box::new(Watched::new(dataset, cancel.clone()));
                interruptible(py, &cancel, || Loader::new(watched, &options))?.or_raise()?
            }
        };
        let fields = loader.schema().fields().iter();
        let names = fields.map(|field| PyString::intern(py, &field.name).unbind()).collect();
        Ok(Self { process: Process::current(), loader, names, pool: Arc::default() })
    }

    fn __len__(&self) -> usize {
        self.loader.len()
    }

    /// `(name, dtype, shape, kind)` of the columns of a batch, without its first axis.
    #[getter]
    fn fields(&self) -> Vec<(String, &'static str, Vec<usize>, &'static str)> {
        self.loader.schema().fields().iter().map(describe).collect()
    }

    /// `(message, whether it was written now)` for each file of decoded images.
    #[getter]
    fn cached(&self) -> Vec<(String, bool)> {
        self.loader.cached().iter().map(|images| (images.to_string(), images.seconds.is_some())).collect()
    }

    /// The episode and the first row of a clip.
    fn clip(&self, #[pyo3(from_py_with = integers::index)] index: usize) -> Option<(usize, usize)> {
        self.loader.clip(index).map(|clip| (clip.episode, clip.start))
    }

    /// The episode and row of the goal of a clip in an epoch.
    fn goal(
        &self,
        #[pyo3(from_py_with = integers::index)] index: usize,
        #[pyo3(from_py_with = integers::epoch)] epoch: u64,
    ) -> Option<(usize, usize)> {
        self.loader.goal(index, epoch)
    }

    /// Clips by number, `[len(indices), …]` by column.
    #[pyo3(signature = (indices, epoch=0))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = integers::indices)] indices: Vec<usize>,
        #[pyo3(from_py_with = integers::epoch)] epoch: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        self.process.check("this open dataset")?;
        let mut batch = self.pool.take().unwrap_or_else(|| self.loader.new_batch());
        py.detach(|| self.loader.read_in(epoch, &indices, &mut batch)).or_raise()?;
        lend(py, batch, &self.pool, &self.names)
    }

    /// Batches that threads read ahead. With `capacity`, they are read into `tables`, dicts of arrays.
    #[pyo3(signature = (size, shuffle=None, drop_last=false, epochs=None, ahead=2, shard=(0, 1), position=None, make_table=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn batches(
        &self,
        py: Python<'_>,
        size: usize,
        shuffle: Option<u64>,
        drop_last: bool,
        epochs: Option<u64>,
        ahead: usize,
        shard: (usize, usize),
        position: Option<&str>,
        make_table: Option<Bound<'_, PyAny>>,
    ) -> PyResult<BatchStream> {
        self.process.check("this loader")?;
        let options = BatchOptions::default()
            .size(size)
            .shuffle(shuffle)
            .drop_last(drop_last)
            .epochs(epochs)
            .ahead(ahead)
            .shard(shard.0, shard.1);
        let position: Option<Position> =
            match position {
                Some(json) => Some(serde_json::from_str(json).map_err(|error| {
                    PyValueError::new_err(format!("this is no state of a loader: {error}"))
                })?),
                None => None,
            };
        let schema = self.loader.schema().clone();
        let mut failed = None;
        let table = || match &make_table {
            None => AnyTable::Own(self.loader.new_batch()),
            Some(make) => match foreign(&schema, size, make) {
                Ok(table) => AnyTable::Foreign(table),
                Err(error) => {
                    failed.get_or_insert(error);
                    AnyTable::Own(self.loader.new_batch())
                }
            },
        };
        let batches = self.loader.batches_into(&options, position.as_ref(), table);
        if let Some(error) = failed {
            return Err(error);
        }
        Ok(BatchStream {
            process: Process::current(),
            batches: Mutex::new(Some(batches.or_raise()?)),
            schema,
            size,
            make_table: make_table.map(Bound::unbind),
            names: self.names.clone(),
            pool: py.detach(Arc::default),
        })
    }
}

/// A table over the arrays that `make` makes.
fn foreign(schema: &Arc<Schema>, size: usize, make: &Bound<'_, PyAny>) -> PyResult<ForeignTable> {
    let (arrays, owner) = make.call0()?.extract::<(Bound<'_, PyDict>, Bound<'_, PyAny>)>()?;
    ForeignTable::new(schema, size, &arrays, owner.unbind())
}

/// Batches, epoch after epoch, read ahead by threads.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
pub(crate) struct BatchStream {
    process: Process,
    /// `None` once it is closed.
    batches: Mutex<Option<Batches<AnyTable>>>,
    schema: Arc<Schema>,
    size: usize,
    make_table: Option<Py<PyAny>>,
    names: Arc<[Py<PyString>]>,
    pool: Arc<Pool>,
}

#[pymethods]
impl BatchStream {
    /// The next batch, by column `[clips, …]`; `None` at the end of an epoch. With `make_table`: what that gave, the
    /// number of rows, and texts by column.
    fn next<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.process.check("this loader")?;
        let mut table = match &self.make_table {
            Some(make) => AnyTable::Foreign(foreign(&self.schema, self.size, make.bind(py))?),
            None => AnyTable::Own(self.pool.take().unwrap_or_else(|| Batch::new(self.schema.clone(), 0))),
        };
        let read = py.detach(|| lock(&self.batches).as_mut().map(|batches| batches.next_batch(&mut table)));
        let full = read.ok_or_else(closed)?.or_raise()?;
        match table {
            AnyTable::Own(batch) if !full => {
                self.pool.put(batch);
                Ok(None)
            }
            AnyTable::Foreign(_) if !full => Ok(None),
            AnyTable::Own(batch) => {
                lend(py, batch, &self.pool, &self.names).map(|batch| Some(batch.into_any()))
            }
            AnyTable::Foreign(table) => {
                let (owner, rows, texts) = table.into_parts();
                Ok(Some((owner, rows, texts).into_pyobject(py)?.into_any()))
            }
        }
    }

    /// Reads so many batches and drops them, or all up to the end of an epoch; returns the number of clips. It tells how
    /// fast the core is alone.
    fn skip(&self, py: Python<'_>, batches: usize) -> PyResult<usize> {
        self.process.check("this loader")?;
        let skipped = py.detach(|| {
            let mut open = lock(&self.batches);
            let stream = open.as_mut()?;
            let spare = self.pool.take().unwrap_or_else(|| Batch::new(self.schema.clone(), 0));
            let mut table = AnyTable::Own(spare);
            let mut clips = 0;
            for _ in 0..batches {
                match stream.next_batch(&mut table) {
                    Ok(true) => {}
                    Ok(false) => break,
                    Err(error) => return Some(Err(error)),
                }
                clips += match &table {
                    AnyTable::Own(batch) => batch.rows(),
                    AnyTable::Foreign(_) => 0,
                };
            }
            if let AnyTable::Own(batch) = table {
                self.pool.put(batch);
            }
            Some(Ok(clips))
        });
        skipped.ok_or_else(closed)?.or_raise()
    }

    /// Where it is, as JSON, to go on from.
    fn position(&self, py: Python<'_>) -> PyResult<String> {
        self.process.check("this loader")?;
        let position =
            py.detach(|| lock(&self.batches).as_ref().map(Batches::position)).ok_or_else(closed)?;
        serde_json::to_string(&position).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Ends its threads. Batches that were given stay valid.
    fn close(&self, py: Python<'_>) {
        if self.process.is_current() {
            py.detach(|| drop(lock(&self.batches).take()));
        }
    }
}

fn closed() -> PyErr {
    PyValueError::new_err("this loader was closed; make a new one")
}

impl Drop for BatchStream {
    fn drop(&mut self) {
        if !self.process.is_current() {
            // A fork has none of its threads, and would wait for them for ever.
            mem::forget(self.batches.get_mut().unwrap_or_else(PoisonError::into_inner).take());
        }
    }
}
