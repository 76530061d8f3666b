//! Who chooses the actions of a run: a native policy by its name, on the World's threads, or a Python object, always on the
//! calling thread.

use std::time::Instant;

use numpy::PyArray1;
use pyo3::prelude::*;
use swm::core::{
    Actions, Cancel, Column, Policy, PolicyError, Recorder, Rollout, Run, View, World, WorldError,
};

use crate::errors::OrRaise as _;
use crate::infos;
use crate::interrupt::{PERIOD, interruptible_with};
use crate::mirror::Mirror;
use crate::world::Shared;

/// Stands for a Python policy, so that records name it. Its actions come from [`drive`].
pub(crate) struct Foreign(pub(crate) String);

impl Policy for Foreign {
    fn describe(&self) -> String {
        self.0.clone()
    }

    fn act(&mut self, _view: &View<'_>, _actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        let reason = "it is a Python object, which only a run from Python asks for actions".to_owned();
        Err(PolicyError::Unsupported { policy: self.0.clone(), reason })
    }

    fn is_parallel(&self) -> bool {
        false
    }
}

/// Runs the episodes of `rollout`, watched by `recorder`.
///
/// `act`, if given, is a Python function that gets the environments that have just begun another episode (bool `(N,)`, or
/// `None`), and returns actions `(N, …)`; it is called here, on the calling thread. Otherwise the World's own policy acts,
/// on a thread of the run. `tick` is called some twenty times a second, to show progress; what it raises ends the run.
pub(crate) fn drive(
    py: Python<'_>,
    shared: &Shared,
    rollout: Rollout,
    recorder: &mut dyn Recorder,
    act: Option<&Bound<'_, PyAny>>,
    mut tick: impl FnMut() -> PyResult<()>,
) -> PyResult<()> {
    let Some(act) = act else {
        return run_native(py, shared, rollout, tick, |world, rollout| world.run(rollout, recorder));
    };
    let mut core = shared.lock()?;
    let (world, mirror) = core.parts()?;
    let mut steps = py.detach(|| Steps::begin(world, mirror, &rollout, recorder))?;
    let mut ticked = Instant::now();
    while let Some(begun) = steps.needs_actions() {
        let given = match begun {
            None => act.call1((py.None(),))?,
            Some(begun) => act.call1((PyArray1::from_vec(py, begun),))?,
        };
        let actions = infos::actions(&shared.spec, shared.num_envs, &given)?;
        py.detach(|| steps.take(actions))?;
        if ticked.elapsed() >= PERIOD {
            ticked = Instant::now();
            py.check_signals()?;
            tick()?;
        }
    }
    Ok(())
}

/// Runs `rollout` with the world's own policy, without the interpreter's lock; a signal ends it.
pub(crate) fn run_native(
    py: Python<'_>,
    shared: &Shared,
    rollout: Rollout,
    tick: impl FnMut() -> PyResult<()>,
    run: impl FnOnce(&mut World, &Rollout) -> Result<(), WorldError> + Send,
) -> PyResult<()> {
    let cancel = Cancel::new();
    let rollout = rollout.cancel(&cancel);
    interruptible_with(py, &cancel, tick, || {
        let mut core = shared.lock()?;
        let (world, mirror) = core.parts()?;
        let result = run(world, &rollout).or_raise();
        mirror.end_run();
        result
    })?
}

/// A run whose actions come from Python, step by step, and what Python sees of it.
pub(crate) struct Steps<'a> {
    run: Run<'a>,
    mirror: &'a mut Mirror,
    last: Option<Column>,
}

impl<'a> Steps<'a> {
    /// Resets the first environments.
    pub(crate) fn begin(
        world: &'a mut World,
        mirror: &'a mut Mirror,
        rollout: &'a Rollout,
        recorder: &'a mut dyn Recorder,
    ) -> PyResult<Self> {
        mirror.begin_run();
        let run = world.begin(rollout, recorder).or_raise()?;
        Ok(Self { run, mirror, last: None })
    }

    /// Unless the run is over: the environments that have begun an episode after another one, `[N]`, if there are any.
    pub(crate) fn needs_actions(&mut self) -> Option<Option<Vec<bool>>> {
        let view = self.run.needs_actions()?;
        Some(self.mirror.follow(&view, self.last.as_ref().map(Column::as_slice)))
    }

    /// A step with `actions`, `[N, A]`.
    pub(crate) fn take(&mut self, actions: Column) -> PyResult<()> {
        self.run.set_actions(actions.as_slice()).or_raise()?;
        self.run.advance().or_raise()?;
        self.last = Some(actions);
        Ok(())
    }
}

impl Drop for Steps<'_> {
    fn drop(&mut self) {
        self.mirror.end_run();
    }
}
