//! The requests that were begun: each on a thread of its own, with what it reports.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::http::StatusCode;
use serde_json::{Value as Json, json};
use swm_core::Cancel;
use swm_core::error::BoxError;
use swm_tasks::request::{Divided, Figures, Message, Progress, Report, Stage};

use crate::error::{Refusal, sentence};
use crate::roots::Roots;
use crate::server::App;

/// At once: each uses all cores.
const MAX_RUNNING: usize = 2;
/// Of older ones, the files tell.
const MAX_KEPT: usize = 100;

/// Requests by their number.
#[derive(Default)]
pub(crate) struct Requests(Mutex<Vec<Arc<Running>>>);

/// A request that was begun.
struct Running {
    number: usize,
    request: &'static str,
    name: String,
    words: Vec<String>,
    cancel: Cancel,
    state: Mutex<State>,
}

/// How far it is.
#[derive(Clone, Debug, Default)]
struct State {
    /// `None` while it runs; then why it failed, if it did.
    ended: Option<Result<(), String>>,
    stage: String,
    unit: &'static str,
    done: u64,
    total: u64,
    line: String,
    notes: Vec<String>,
}

impl Requests {
    fn all(&self) -> MutexGuard<'_, Vec<Arc<Running>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether one is at work.
    pub(crate) fn any_running(&self) -> bool {
        self.all().iter().any(|one| one.is_running())
    }

    /// Asks all to end early.
    pub(crate) fn stop_all(&self) {
        self.all().iter().for_each(|one| one.cancel.cancel());
    }

    /// Asks this one to end early.
    ///
    /// # Errors
    ///
    /// There is none of this number.
    pub(crate) fn stop(&self, number: usize) -> Result<(), Refusal> {
        let all = self.all();
        let one = all.iter().find(|one| one.number == number);
        one.ok_or_else(|| Refusal::bad(format!("no request has the number {number}")))?.cancel.cancel();
        Ok(())
    }

    /// Refuses a name whose result is being made.
    ///
    /// # Errors
    ///
    /// It is.
    pub(crate) fn check_name(&self, name: &str) -> Result<(), Refusal> {
        check_name(&self.all(), name)
    }

    /// Begins a request whose result has this name; its number.
    ///
    /// # Errors
    ///
    /// Others run already, as many as may, or one with this result.
    pub(crate) fn begin(
        &self,
        app: &Arc<App>,
        request: Divided,
        words: Vec<String>,
        name: String,
    ) -> Result<usize, Refusal> {
        let mut all = self.all();
        check_name(&all, &name)?;
        if all.iter().filter(|one| one.is_running()).count() >= MAX_RUNNING {
            let reason = format!("{MAX_RUNNING} requests run already; wait for one, or stop it");
            return Err(Refusal::new(StatusCode::CONFLICT, reason));
        }
        let number = all.last().map_or(1, |last| last.number + 1);
        let one = Arc::new(Running {
            number,
            request: request.name(),
            name,
            words,
            cancel: Cancel::new(),
            state: Mutex::default(),
        });
        let (own, registry) = (Arc::clone(&one), app.registry.clone());
        let thread = std::thread::Builder::new().name("swm-ui request".to_owned()).spawn(move || {
            let work = || request.run(&registry, &mut Reporter(Arc::clone(&own)));
            let ended = match catch_unwind(AssertUnwindSafe(work)) {
                Ok(done) => done.map_err(|error| sentence(&error)),
                Err(_) => Err("it failed within the program, which is a bug".to_owned()),
            };
            own.state().ended = Some(ended);
        });
        app.keep(thread.map_err(|error| Refusal::bad(format!("no thread can be started: {error}")))?);
        all.push(one);
        if all.len() > MAX_KEPT {
            all.remove(0);
        }
        Ok(number)
    }

    /// As the page shows them, the newest first.
    pub(crate) fn list(&self, roots: &Roots) -> Vec<Json> {
        let one = |one: &Arc<Running>| {
            let State { ended, stage, unit, done, total, line, notes } = one.state().clone();
            let state = match (&ended, one.cancel.is_cancelled()) {
                (None, false) => "running",
                (None, true) => "stopping",
                (Some(Ok(())), _) => "done",
                (Some(Err(_)), true) => "stopped",
                (Some(Err(_)), false) => "failed",
            };
            json!({
                "number": one.number, "request": one.request, "name": one.name, "id": roots.saved_id(&one.name),
                "words": one.words, "state": state, "error": ended.and_then(Result::err), "stage": stage, "unit": unit,
                "done": done, "total": total, "line": line, "notes": notes,
            })
        };
        self.all().iter().rev().map(one).collect()
    }
}

fn check_name(all: &[Arc<Running>], name: &str) -> Result<(), Refusal> {
    if !all.iter().any(|one| one.is_running() && one.name == name) {
        return Ok(());
    }
    let reason = format!("`{name}` is being made; wait, stop it, or choose another name");
    Err(Refusal::new(StatusCode::CONFLICT, reason))
}

impl Running {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_running(&self) -> bool {
        self.state().ended.is_none()
    }
}

/// Keeps what a request reports.
struct Reporter(Arc<Running>);

/// Counts a stage.
struct Counter(Arc<Running>);

impl Report for Reporter {
    fn note(&mut self, note: &Message) {
        self.0.state().notes.push(note.to_string());
    }

    fn info(&mut self, info: &Message) {
        self.0.state().line = info.to_string();
    }

    fn cancel(&self) -> Cancel {
        self.0.cancel.clone()
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        let mut state = self.0.state();
        (state.stage, state.unit) = (stage.name.to_owned(), stage.unit);
        (state.done, state.total) = (0, stage.total);
        drop(state);
        Ok(Box::new(Counter(Arc::clone(&self.0))))
    }
}

impl Progress for Counter {
    fn done(&self, _success: Option<bool>) {
        self.advance(1);
    }

    fn advance(&self, units: u64) {
        self.0.state().done += units;
    }

    fn before(&self, units: u64) {
        self.advance(units);
    }

    fn now(&self, what: &str) {
        what.clone_into(&mut self.0.state().line);
    }

    fn figures(&self, figures: &Figures) {
        self.0.state().line.clone_from(&figures.line);
    }
}
