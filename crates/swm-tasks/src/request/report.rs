//! What a request reports to while it runs: notes, progress, and the flag that ends it early.

use std::time::Duration;

use swm_core::Cancel;
use swm_core::error::BoxError;

use super::{Message, TaskError};
use crate::evaluation::Role;

/// What a request reports to while it runs.
pub trait Report {
    /// Something that the user should know and that stops nothing.
    fn note(&mut self, note: &Message);

    /// How the work goes, for whoever watches it.
    fn info(&mut self, _info: &Message) {}

    /// The flag that ends the work early.
    fn cancel(&self) -> Cancel {
        Cancel::new()
    }

    /// A stage of the work begins; the progress is that of this stage until it is dropped.
    ///
    /// # Errors
    ///
    /// The front end cannot show it; the work ends.
    fn begin(&mut self, _stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        Ok(Box::new(()))
    }

    /// Does work that needs nothing of the thread that runs the request. A front end with duties on that thread (signals, a
    /// progress bar) does it on another one.
    ///
    /// # Errors
    ///
    /// The front end was interrupted.
    fn apart(&mut self, work: &mut (dyn FnMut() + Send)) -> Result<(), BoxError> {
        work();
        Ok(())
    }
}

/// A stage of the work: so many units, counted one by one.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// Whose episodes they are, or what is measured.
    pub name: &'a str,
    /// Of an evaluation, the reference policy that it is.
    pub role: Option<Role>,
    /// What is counted: `episodes`.
    pub unit: &'static str,
    /// How many there are.
    pub total: u64,
}

/// Counts the units of a stage.
pub trait Progress: Send + Sync {
    /// One more is done; of an episode, whether it was a success, where that is known.
    fn done(&self, success: Option<bool>);

    /// So many more are done.
    fn advance(&self, units: u64) {
        for _ in 0..units {
            self.done(None);
        }
    }

    /// So many units were there before.
    fn before(&self, _units: u64) {}

    /// One more episode is written, at this index of the run, with so many rows.
    fn written(&self, _episode: u64, _rows: usize) {
        self.done(None);
    }

    /// What is at work, in few words.
    fn now(&self, _what: &str) {}

    /// What was measured of the work so far.
    fn figures(&self, _figures: &Figures) {}
}

/// What was measured of the work so far, in words.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// All of it, in a line: `20 of 100: train loss 0.5`.
    pub line: String,
    /// In few words, for where a bar shows the rest; `None`: the line belongs beside a bar, too.
    pub brief: Option<String>,
    /// The time that the work will still take, where it is known.
    pub left: Option<Duration>,
}

impl Progress for () {
    fn done(&self, _success: Option<bool>) {}

    fn advance(&self, _units: u64) {}
}

/// Ignores everything.
impl Report for () {
    fn note(&mut self, _note: &Message) {}
}

/// Keeps the notes.
impl Report for Vec<Message> {
    fn note(&mut self, note: &Message) {
        self.push(note.clone());
    }
}

/// As [`Report::apart`], for work with a result.
///
/// # Errors
///
/// As of [`Report::apart`].
pub fn apart<T: Send>(report: &mut dyn Report, work: impl FnOnce() -> T + Send) -> Result<T, TaskError> {
    let (mut work, mut result) = (Some(work), None);
    report.apart(&mut || result = work.take().map(|work| work()))?;
    result.ok_or_else(|| "the work was not done".into())
}
