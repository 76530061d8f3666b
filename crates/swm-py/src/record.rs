//! Recording of datasets, by native writers and by Python ones.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swm::core::dataset::DatasetRecorder;
use swm::core::error::BoxError;
use swm::core::{Batch, Cancel, Column, EpisodeSink, Metadata, Rollout, Schema};
use swm::tasks::request::{self, Message, Record, Recorded, Report, Request as _, Stage};

use crate::arrays::{into_array, lock};
use crate::errors::{OrRaise as _, SwmError};
use crate::evaluate::{Progress, rollout};
use crate::fork::Process;
use crate::infos;
use crate::integers;
use crate::interrupt::PERIOD;
use crate::manifest::from_json;
use crate::policy::{Steps, drive, run_native};
use crate::words::Arguments;
use crate::world::{PyWorld, Shared, registry};

/// Records episodes of a World into a dataset. `request`: a JSON object of the settings of `Record`; those of the World are its own.
/// Gives a JSON object with what was written, and notes.
///
/// `act`: see `policy::drive`.
#[pyfunction]
#[pyo3(signature = (world, act, request, options=None, tick=None))]
fn collect(
    py: Python<'_>,
    world: &Bound<'_, PyWorld>,
    act: Option<Py<PyAny>>,
    request: &str,
    options: Option<Py<PyAny>>,
    tick: Option<Py<PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let request = Record::from_json(&from_json("the request", request)?).or_raise()?;
    let world = world.get();
    let mut heard = Heard::default();
    let progress = heard.progress.clone();
    let recorded = py.detach(|| {
        request.write(registry(), &mut heard, |episodes, _cancel, sink, count| {
            Python::attach(|py| {
                let bind = |object: &Option<Py<PyAny>>| object.as_ref().map(|object| object.bind(py).clone());
                let [act, options, tick] = [&act, &options, &tick].map(bind);
                let range = (episodes.start, episodes.end);
                let rollout = rollout(world, range, request.seed, options.as_ref(), None)?;
                let tell = || progress.tell(tick.as_ref());
                match act {
                    None => run_native(py, &world.shared, rollout, tell, |world, rollout| {
                        world.record_dataset_with(rollout, sink, count)
                    }),
                    // Actions from Python leave no threads free to write meanwhile.
                    Some(act) => {
                        let mut recorder = (DatasetRecorder::new(sink), count);
                        drive(py, &world.shared, rollout, &mut recorder, Some(&act), tell)
                    }
                }
            })
            .map_err(BoxError::from)
        })
    });
    let Recorded { episodes, total_episodes, rows, .. } = recorded.or_raise()?;
    progress.tell(tick.as_ref().map(|tick| tick.bind(py)))?;
    let json = serde_json::json!({
        "path": request.out,
        "episodes": episodes,
        "total_episodes": total_episodes,
        "steps": rows,
    });
    Ok((json.to_string(), heard.notes.iter().map(|note| note.in_words(&Arguments::default())).collect()))
}

/// Counts committed episodes, and keeps the notes.
#[derive(Default)]
struct Heard {
    progress: Progress,
    notes: Vec<Message>,
}

impl Report for Heard {
    fn note(&mut self, note: &Message) {
        self.notes.push(note.clone());
    }

    fn begin(&mut self, _stage: &Stage<'_>) -> Result<Box<dyn request::Progress>, BoxError> {
        Ok(Box::new(self.progress.clone()))
    }
}

impl request::Progress for Progress {
    fn done(&self, success: Option<bool>) {
        self.count(success == Some(true));
    }

    fn advance(&self, units: u64) {
        Progress::advance(self, units);
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
    #[pyo3(from_py_with = integers::seed)] seed: u64,
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
