//! Recording of datasets, by native writers and by Python ones.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swm::core::dataset::{DatasetRecorder, EncodedBatch, RowEncoder};
use swm::core::error::BoxError;
use swm::core::{Batch, Cancel, Column, EpisodeSink, Metadata, Rollout, Schema};
use swm::data::tools::parts::other_recording;
use swm::data::{DatasetWriter, WriteMode, WriteOptions};

use crate::arrays::{into_array, lock};
use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::{Progress, rollout};
use crate::fork::Process;
use crate::infos;
use crate::interrupt::PERIOD;
use crate::policy::{Steps, drive, run_native};
use crate::world::{PyWorld, Shared, registry};

/// Records `episodes` more episodes into the file `path`; gives a JSON object with what was written, and in what it `differs`
/// from the recording that it is appended to.
///
/// `act`: see `policy::drive`. `mode`: `append`, `overwrite` or `error`.
#[pyfunction]
#[pyo3(signature = (world, act, path, episodes, seed, options=None, format=None, mode="error", quality=None, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn collect(
    py: Python<'_>,
    world: &Bound<'_, PyWorld>,
    act: Option<&Bound<'_, PyAny>>,
    path: PathBuf,
    episodes: u64,
    seed: u64,
    options: Option<&Bound<'_, PyAny>>,
    format: Option<&str>,
    mode: &str,
    quality: Option<u8>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let world = world.get();
    let mode: WriteMode = mode.parse().map_err(SwmError::new_err)?;
    let how = WriteOptions::default().mode(mode).quality(quality);
    let held = (mode == WriteMode::Append && path.exists()).then(|| swm::data::open_in(registry(), &path));
    let continues = held.and_then(|held| Some(held.ok()?.info().runs.last()?.1.clone()));
    let mut writer = py.detach(|| swm::data::create_in(registry(), &path, &how, format)).or_raise()?;
    let first = writer.num_episodes();
    let rollout = rollout(world, (first, first + episodes), seed, options, None)?;
    let progress = Progress::default();
    let mut sink = Sink { writer: writer.as_mut(), progress: progress.clone(), continues, differs: None };
    let mut steps = Progress::default();
    let counted = steps.clone();
    let tell = || progress.tell(tick);
    let recorded = match act {
        None => run_native(py, &world.shared, rollout, tell, |world, rollout| {
            world.record_dataset_with(rollout, &mut sink, &mut steps)
        }),
        // Actions from Python leave no threads free to write meanwhile.
        Some(_) => {
            let mut recorder = (DatasetRecorder::new(&mut sink), &mut steps);
            drive(py, &world.shared, rollout, &mut recorder, act, tell)
        }
    };
    let differs = sink.differs;
    py.detach(|| drop(writer));
    recorded?;
    progress.tell(tick)?;
    let json = serde_json::json!({
        "path": path,
        "episodes": episodes,
        "total_episodes": first + episodes,
        "steps": counted.steps(),
        "differs": differs,
    });
    Ok(json.to_string())
}

/// Counts committed episodes.
struct Sink<'a> {
    writer: &'a mut dyn DatasetWriter,
    progress: Progress,
    /// The last run of the file that is appended to.
    continues: Option<Metadata>,
    /// In what this one is of another recording.
    differs: Option<String>,
}

impl EpisodeSink for Sink<'_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        self.differs = self.continues.as_ref().and_then(|run| other_recording(run, metadata));
        self.writer.begin(schema, metadata)
    }

    fn holds(&self, column: &str) -> bool {
        self.writer.holds(column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.writer.write_episode(rows)?;
        self.progress.count(false);
        Ok(())
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.writer.row_encoder(column)
    }

    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        self.writer.write_encoded_episode(rows)?;
        self.progress.count(false);
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.writer.finish()
    }
}

/// What the thread of a run tells the thread that reads its episodes.
enum Event {
    /// A Python policy must act; the environments that have begun another episode.
    Act(Option<Vec<bool>>, SyncSender<Option<Column>>),
    /// An episode is over.
    Episode(Batch),
    /// The run is over.
    Done(PyResult<()>),
}

/// An iterator over whole episodes of a run, each a dict of arrays `(T, …)`, for writers that are Python objects. The run is
/// on a thread of its own; a Python policy acts on the thread that iterates.
#[pyclass(frozen, module = "stable_worldmodel_rs._swm")]
struct Episodes {
    shared: Arc<Shared>,
    process: Process,
    act: Option<Py<PyAny>>,
    cancel: Cancel,
    running: Mutex<Option<Running>>,
}

struct Running {
    events: Receiver<Event>,
    thread: JoinHandle<()>,
}

/// Begins a run whose episodes are read one by one; see [`Episodes`]. `held`: columns of the dataset that they continue.
#[pyfunction]
#[pyo3(signature = (world, act, episodes, seed, options=None, held=Vec::new()))]
fn episodes(
    world: &Bound<'_, PyWorld>,
    act: Option<Bound<'_, PyAny>>,
    episodes: (u64, u64),
    seed: u64,
    options: Option<&Bound<'_, PyAny>>,
    held: Vec<String>,
) -> PyResult<Episodes> {
    let world = world.get();
    let cancel = Cancel::new();
    let rollout = rollout(world, episodes, seed, options, None)?.cancel(&cancel);
    let shared = Arc::clone(&world.shared);
    let (sender, events) = sync_channel(2);
    let is_foreign = act.is_some();
    let thread = thread::Builder::new().name("swm-episodes".to_owned()).spawn({
        let (shared, sender) = (Arc::clone(&shared), sender);
        move || {
            let result = run(&shared, &rollout, &sender, is_foreign, held);
            // Nobody listens where the iterator was dropped.
            _ = sender.send(Event::Done(result));
        }
    });
    let thread = thread.map_err(|error| SwmError::new_err(format!("cannot start a thread: {error}")))?;
    let running = Mutex::new(Some(Running { events, thread }));
    Ok(Episodes { shared, process: Process::current(), act: act.map(Bound::unbind), cancel, running })
}

/// The run itself, on its thread.
fn run(
    shared: &Shared,
    rollout: &Rollout,
    sender: &SyncSender<Event>,
    is_foreign: bool,
    held: Vec<String>,
) -> PyResult<()> {
    let mut core = shared.lock()?;
    let (world, mirror) = core.parts()?;
    let mut sink = Sent { sender: sender.clone(), first: rollout.episodes.start, held };
    let mut recorder = DatasetRecorder::new(&mut sink);
    if !is_foreign {
        let result = world.run(rollout, &mut recorder).or_raise();
        mirror.end_run();
        return result;
    }
    let mut steps = Steps::begin(world, mirror, rollout, &mut recorder)?;
    while let Some(begun) = steps.needs_actions() {
        let (reply, answer) = sync_channel(1);
        let asked = sender.send(Event::Act(begun, reply)).is_ok();
        // Nobody answers where the policy raised, or the iterator was dropped.
        let Some(actions) = asked.then(|| answer.recv().ok().flatten()).flatten() else { return Ok(()) };
        steps.take(actions)?;
    }
    Ok(())
}

/// Sends whole episodes.
struct Sent {
    sender: SyncSender<Event>,
    first: u64,
    held: Vec<String>,
}

impl EpisodeSink for Sent {
    fn begin(&mut self, _schema: &Arc<Schema>, _metadata: &Metadata) -> Result<u64, BoxError> {
        Ok(self.first)
    }

    fn holds(&self, column: &str) -> bool {
        self.held.iter().any(|held| held == column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.sender.send(Event::Episode(rows.clone())).map_err(|_| "the episodes are no longer read".into())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

#[pymethods]
impl Episodes {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// The next episode.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.process.check("this iterator over episodes")?;
        let Some(mut running) = lock(&self.running).take() else { return Ok(None) };
        let next = self.next(py, &mut running.events);
        if let Ok(Some(_)) = next {
            *lock(&self.running) = Some(running);
        } else {
            self.cancel.cancel();
            running.end(py);
        }
        next
    }

    /// Ends the run early.
    fn close(&self, py: Python<'_>) {
        self.cancel.cancel();
        let running = lock(&self.running).take();
        if let Some(running) = running {
            running.end(py);
        }
    }
}

impl Running {
    /// Waits for the end of the run, which nobody reads any more.
    fn end(self, py: Python<'_>) {
        drop(self.events);
        py.detach(|| _ = self.thread.join());
    }
}

impl Episodes {
    /// Answers the run until an episode is over, or the run is (`None`).
    fn next<'py>(
        &self,
        py: Python<'py>,
        events: &mut Receiver<Event>,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        loop {
            let waiting = &mut *events;
            match py.detach(move || waiting.recv_timeout(PERIOD)) {
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Ok(Event::Act(begun, reply)) => {
                    let begun = begun.map(|begun| PyArray1::from_vec(py, begun));
                    let act = self.act.as_ref().map(|act| act.bind(py));
                    let act = act.ok_or_else(|| SwmError::new_err("the run has no policy"))?;
                    let given = act.call1((begun,))?;
                    let actions = infos::actions(&self.shared.spec, self.shared.num_envs, &given)?;
                    // Where nobody listens, the run has ended, and says why.
                    _ = reply.send(Some(actions));
                }
                Ok(Event::Episode(rows)) => return to_dict(py, rows).map(Some),
                Ok(Event::Done(result)) => return result.map(|()| None),
            }
        }
    }
}

impl Drop for Episodes {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}

/// The columns of an episode, `(T, …)` each; constants of the episode stand in every step.
fn to_dict(py: Python<'_>, rows: Batch) -> PyResult<Bound<'_, PyDict>> {
    let (schema, steps) = (Arc::clone(rows.schema()), rows.rows());
    let episode = PyDict::new(py);
    for (field, column) in schema.fields().iter().zip(rows.into_columns()) {
        let shape: Vec<usize> = std::iter::once(steps).chain(field.shape.iter().copied()).collect();
        episode.set_item(&field.name, into_array(py, column, &shape)?)?;
    }
    Ok(episode)
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Episodes>()?;
    m.add_function(wrap_pyfunction!(collect, m)?)?;
    m.add_function(wrap_pyfunction!(episodes, m)?)
}
