//! The reports of a request on the command line: notes and progress on the error output, Ctrl-C as the flag that ends it.

use std::sync::atomic::{AtomicU64, Ordering};

use indicatif::ProgressBar;
use swm_core::Cancel;
use swm_core::error::BoxError;
use swm_tasks::request::{Message, Progress, Report, Stage};

use super::Output;
use super::words::Options;

type Watch<'a> = Box<dyn Fn(&str) -> Cancel + 'a>;

/// Reports to the error output.
pub(super) struct Reporter<'a> {
    output: &'a Output,
    cancel: Cancel,
    /// What ends a stage of this name, in place of `cancel`.
    watch: Option<Watch<'a>>,
}

impl<'a> Reporter<'a> {
    /// Reports of a request that `cancel` ends.
    pub(super) fn new(output: &'a Output, cancel: Cancel) -> Self {
        Self { output, cancel, watch: None }
    }

    /// Reports of a request each of whose stages is ended by what `watch` makes of its name, which its bar shows.
    pub(super) fn of_stages(output: &'a Output, watch: impl Fn(&str) -> Cancel + 'a) -> Self {
        Self { output, cancel: Cancel::new(), watch: Some(Box::new(watch)) }
    }
}

impl Report for Reporter<'_> {
    fn note(&mut self, note: &Message) {
        Report::note(&mut &*self.output, note);
    }

    fn info(&mut self, info: &Message) {
        self.output.note(info.in_words(&Options));
    }

    fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        let bar = self.output.bar(stage.total, stage.unit);
        let label = stage.role.map_or(String::new(), |role| role.name().to_owned());
        bar.set_message(label.clone());
        if let Some(watch) = &self.watch {
            self.cancel = watch(stage.name);
            bar.set_message(stage.name.to_owned());
        }
        Ok(Box::new(Bar { bar, label, successes: AtomicU64::new(0) }))
    }
}

/// The bar of a stage, which goes with it.
struct Bar {
    bar: ProgressBar,
    label: String,
    successes: AtomicU64,
}

impl Progress for Bar {
    fn done(&self, success: Option<bool>) {
        self.bar.inc(1);
        if let Some(success) = success {
            let successes =
                self.successes.fetch_add(u64::from(success), Ordering::Relaxed) + u64::from(success);
            let comma = if self.label.is_empty() { "" } else { ", " };
            self.bar.set_message(format!("{}{comma}{successes} successful", self.label));
        }
    }

    fn advance(&self, units: u64) {
        self.bar.inc(units);
    }

    fn now(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
