//! Evaluations: episodes of a run, or of chosen starts and goals, under a native policy or a Python one.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pyo3::prelude::*;
use pyo3::types::PyList;
use swm::core::error::BoxError;
use swm::core::evaluate::{EvaluationRecorder, choose_starts};
use swm::core::{EpisodeEnd, EpisodeSeed, LiveStep, Recorder, ResetOptions, Rollout};

use crate::errors::SwmError;
use crate::integers;
use crate::manifest::boxed;
use crate::media::VideoFolder;
use crate::policy::drive;
use crate::world::PyWorld;

/// How far a run is, for progress bars.
#[derive(Clone, Default)]
pub(crate) struct Progress(Arc<Counters>);

#[derive(Default)]
struct Counters {
    episodes: AtomicU64,
    successes: AtomicU64,
    steps: AtomicU64,
}

impl Progress {
    /// Calls `tick(episodes, successes, steps)`, if there is such a function.
    pub(crate) fn tell(&self, tick: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(tick) = tick else { return Ok(()) };
        let Counters { episodes, successes, steps } = &*self.0;
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        tick.call1((of(episodes), of(successes), of(steps))).map(drop)
    }

    /// Counts from 0 again.
    pub(crate) fn restart(&self) {
        let Counters { episodes, successes, steps } = &*self.0;
        for counter in [episodes, successes, steps] {
            counter.store(0, Ordering::Relaxed);
        }
    }

    /// Counts units in the place of episodes.
    pub(crate) fn advance(&self, units: u64) {
        self.0.episodes.fetch_add(units, Ordering::Relaxed);
    }

    /// Counts an episode that is not seen as a recorder.
    pub(crate) fn count(&self, success: bool) {
        self.0.episodes.fetch_add(1, Ordering::Relaxed);
        self.0.successes.fetch_add(u64::from(success), Ordering::Relaxed);
    }
}

impl Recorder for Progress {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.0.steps.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.count(end.success == Some(true));
        Ok(())
    }
}

/// The episodes `[first, end)` of the run with seed `seed`.
///
/// `options`: one dict for all episodes, or a list with one per episode by index, of which `seeds`, if given, are the
/// episodes' own seeds.
pub(crate) fn rollout(
    world: &PyWorld,
    (first, end): (u64, u64),
    seed: u64,
    options: Option<&Bound<'_, PyAny>>,
    seeds: Option<Vec<Option<u64>>>,
) -> PyResult<Rollout> {
    let rollout = Rollout::new(first..end).seed(seed);
    let listed = options.and_then(|options| options.cast::<PyList>().ok());
    if listed.is_none() && seeds.is_none() {
        return Ok(rollout.options(world.options(options)?));
    }
    let count = listed.map_or(end as usize, PyListMethods::len);
    let mut each: Vec<ResetOptions> = match listed {
        Some(list) => list.iter().map(|options| world.options(Some(&options))).collect::<PyResult<_>>()?,
        None => vec![world.options(options)?; count],
    };
    for (options, seed) in each.iter_mut().zip(seeds.unwrap_or_default()) {
        options.seed = seed.map(EpisodeSeed::new);
    }
    if count < end as usize {
        return Err(SwmError::new_err(format!(
            "options: {count} dicts for {} episodes; give one per episode, or one dict for all",
            end - first
        )));
    }
    Ok(rollout.each(each))
}

/// Evaluates; gives the result as JSON and the paths of the videos.
///
/// `act`: see `policy::drive`. `limit`: actions allowed per episode, in place of the World's. `video`: a folder, for
/// `episode_<i>.mp4` of every episode.
#[pyfunction]
#[pyo3(signature = (world, act, episodes, seed, options=None, seeds=None, limit=None, video=None, tick=None))]
#[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
fn evaluate(
    py: Python<'_>,
    world: &Bound<'_, PyWorld>,
    act: Option<&Bound<'_, PyAny>>,
    episodes: (u64, u64),
    #[pyo3(from_py_with = integers::seed)] seed: u64,
    options: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = integers::seeds)] seeds: Option<Vec<Option<u64>>>,
    #[pyo3(from_py_with = integers::limit)] limit: Option<u64>,
    video: Option<String>,
    tick: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let world = world.get();
    let rollout = rollout(world, episodes, seed, options, seeds)?;
    let mut evaluation = EvaluationRecorder::default();
    let mut videos = video.map(|folder| VideoFolder::new(&folder));
    let progress = Progress::default();
    let mut nobody = ();
    let video: &mut dyn Recorder = videos.as_mut().map_or(&mut nobody, |videos| videos);
    let mut watch = (&mut evaluation, video, progress.clone());
    let before =
        limit.map(|limit| world.shared.lock()?.world().map(|world| world.set_max_episode_steps(Some(limit))));
    let before = before.transpose()?;
    let driven = drive(py, &world.shared, rollout, &mut watch, act, || progress.tell(tick));
    if let Some(before) = before {
        world.shared.lock()?.world()?.set_max_episode_steps(before);
    }
    driven?;
    progress.tell(tick)?;
    let paths = videos.map_or_else(Vec::new, VideoFolder::into_paths);
    let json = serde_json::to_string(&evaluation.result());
    Ok((json.map_err(|error| SwmError::new_err(error.to_string()))?, paths))
}

/// Rows `[episode, row]` of an evaluation from a dataset whose episodes have these lengths.
#[pyfunction(name = "choose_starts")]
fn starts(lengths: Vec<usize>, count: usize, goal_offset: usize, seed: u64) -> PyResult<Vec<[usize; 2]>> {
    choose_starts(&lengths, count, goal_offset, seed).map_err(boxed)
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(evaluate, m)?)?;
    m.add_function(wrap_pyfunction!(starts, m)?)
}
