//! A dataset is read as a whole and checked; what an interrupted recording left is repaired on request.

use std::path::PathBuf;

use serde::Serialize;
use swm_core::{Registry, WorldError};
use swm_data::adapt::Watched;
use swm_data::tools::verify::{Report as Found, verify};
use swm_data::{DataError, Format, OpenOptions, format};
use swm_files::remote::is_remote;

use super::copies::check_exists;
use super::report::apart;
use super::{Fix, Message, Report, Request, Stage, TaskError, must_be_given, open_dataset_with, wrong};

swm_core::settings! {
    /// Read all of a dataset and report what is wrong with it.
    pub struct Verify {
        /// The dataset.
        dataset: PathBuf = PathBuf::new() => "must be given",
        /// Repair what an interrupted recording left, then check.
        fix: bool = false,
        /// With `fix`: only report what would be done.
        dry_run: bool = false,
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
    }
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Verified {
    /// Nothing is wrong, and nothing has to be repaired.
    pub ok: bool,
    /// Steps of the repair that was asked for.
    pub fixed: Vec<String>,
    /// Steps of the repair that an interrupted recording needs.
    pub to_fix: Vec<String>,
    /// Problems and notes.
    pub report: Found,
}

impl Request for Verify {
    const NAME: &'static str = "verify";
    type Outcome = Verified;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("dataset", self.dataset.as_os_str().is_empty())])?;
        if self.dry_run && !self.fix {
            let message = Message::about("dry_run", true, "is about a repair, and none is asked for");
            return Err(message.fix(Fix::Any(vec![Fix::set("fix", true), Fix::Leave("dry_run")])).into());
        }
        if self.fix && is_remote(&self.dataset) {
            let path = self.dataset.display();
            let text =
                format!("{path} lies elsewhere, where nothing is changed; fetch it and repair the copy");
            return Err(Message::about("fix", true, text).fix(Fix::Leave("fix")).into());
        }
        self.opening.check().map_err(wrong)?;
        check_exists(&self.dataset)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Verified, TaskError> {
        self.check(registry)?;
        let path = &self.dataset;
        let fixed = match format::detect(registry, path) {
            Some(format) if self.fix => self.repair(format, report)?,
            _ => Vec::new(),
        };
        let dataset = apart(report, || open_dataset_with(registry, path, &self.opening))??;
        let rows: usize = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode)).sum();
        let name = path.display().to_string();
        let progress = report.begin(&Stage { name: &name, role: None, unit: "rows", total: rows as u64 })?;
        let cancel = report.cancel();
        let mut dataset = Watched::new(dataset, cancel.clone());
        let found = apart(report, || verify(&mut dataset, &mut |rows| progress.advance(rows as u64)))?;
        drop(progress);
        if cancel.is_cancelled() {
            return Err(WorldError::Cancelled.into());
        }
        let to_fix = match format::detect(registry, path) {
            // A recording may be going on: then there is nothing to fix.
            Some(format) if !self.fix || self.dry_run => match format.repair(path, false) {
                Err(error @ (DataError::Damaged { .. } | DataError::Record { .. })) => {
                    return Err(error.into());
                }
                plan => plan.unwrap_or_default(),
            },
            _ => Vec::new(),
        };
        let ok = found.problems.is_empty() && to_fix.is_empty();
        Ok(Verified { ok, fixed, to_fix, report: found })
    }
}

impl Verify {
    /// Repairs the dataset, or reports what would be done.
    fn repair(&self, format: &Format, report: &mut dyn Report) -> Result<Vec<String>, TaskError> {
        let plan = format.repair(&self.dataset, false)?;
        let verb = if self.dry_run { "would" } else { "will" };
        for step in &plan {
            report.info(&Message::new(format!("{verb} {step}")));
        }
        if plan.is_empty() {
            report.info(&Message::new("nothing to fix"));
        }
        if !self.dry_run {
            // Without a step, too: a dataset that it must not change is refused.
            format.repair(&self.dataset, true)?;
        }
        Ok(plan)
    }
}
