//! The reports of a request in Python: notes are kept, progress goes to the bar of the caller, signals end the work.

use pyo3::prelude::*;
use swm::core::Cancel;
use swm::core::error::BoxError;
use swm::tasks::request::{Message, Progress as Counts, Report, Request, Stage};

use crate::errors::in_words;
use crate::evaluate::Progress;
use crate::interrupt::interruptible_with;
use crate::manifest::{from_json, to_json};
use crate::words::Arguments;
use crate::world::registry;

/// What was made as JSON, and notes.
pub(crate) type Made = PyResult<(String, Vec<String>)>;

/// Runs a request: a JSON object of its settings. `begin` is called with the name, the length and the unit of each progress bar.
pub(crate) fn run<R: Request>(
    py: Python<'_>,
    request: &str,
    begin: Option<&Bound<'_, PyAny>>,
    tick: Option<&Bound<'_, PyAny>>,
) -> Made
where
    R::Outcome: serde::Serialize,
{
    let wrong = |error| in_words(error, R::NAME);
    let request = R::from_json(&from_json("the request", request)?).map_err(wrong)?;
    let mut reporter = Reporter::new(py, R::NAME, begin, tick);
    let made = request.run(registry(), &mut reporter).map_err(wrong)?;
    Ok((to_json(&made)?, reporter.notes))
}

/// Reports of a request that runs on the calling thread.
pub(crate) struct Reporter<'a, 'py> {
    py: Python<'py>,
    request: &'static str,
    /// Is called with the name, the length and the unit of each stage.
    begin: Option<&'a Bound<'py, PyAny>>,
    tick: Option<&'a Bound<'py, PyAny>>,
    cancel: Cancel,
    /// How far the stage is.
    pub(crate) progress: Progress,
    /// Notes in words of Python.
    pub(crate) notes: Vec<String>,
}

impl<'a, 'py> Reporter<'a, 'py> {
    /// Reports of the request of this name.
    pub(crate) fn new(
        py: Python<'py>,
        request: &'static str,
        begin: Option<&'a Bound<'py, PyAny>>,
        tick: Option<&'a Bound<'py, PyAny>>,
    ) -> Self {
        let (cancel, progress, notes) = (Cancel::new(), Progress::default(), Vec::new());
        Self { py, request, begin, tick, cancel, progress, notes }
    }
}

impl Report for Reporter<'_, '_> {
    fn note(&mut self, note: &Message) {
        self.notes.push(note.in_words(&Arguments { request: self.request }));
    }

    fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Counts>, BoxError> {
        let label = match stage.role {
            Some(role) => format!("{} (reference)", role.name().replace('-', "_")),
            None => stage.name.to_owned(),
        };
        self.progress.restart();
        self.begin.map_or(Ok(()), |begin| begin.call1((label, stage.total, stage.unit)).map(drop))?;
        Ok(Box::new(self.progress.clone()))
    }

    fn apart(&mut self, work: &mut (dyn FnMut() + Send)) -> Result<(), BoxError> {
        let (progress, tick) = (&self.progress, self.tick);
        interruptible_with(self.py, &self.cancel, || progress.tell(tick), work)?;
        Ok(progress.tell(tick)?)
    }
}
