//! Datasets with the same columns are joined into one.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use swm_core::Registry;
use swm_data::adapt::fill_factors;
use swm_data::tools::compatibility::check_recordings;
use swm_data::tools::copy::{all, is_same};
use swm_data::tools::part_folder::datasets_in;
use swm_data::tools::parts::{arrange, beside_parts};
use swm_data::{DataError, OpenOptions};
use swm_files::remote::is_remote;

use super::super::report::apart;
use super::super::{Message, Report, Request, TaskError, must_be_given, wrong};
use super::images::check_alike;
use super::{CopyOptions, DatasetCopy, Target};

swm_core::settings! {
    /// Join datasets with the same columns into one.
    pub struct Merge {
        /// The datasets to join: two or more, or a folder of parts.
        sources: Vec<PathBuf> = Vec::new() => "must be given",
        /// The file or folder to write.
        out: PathBuf = PathBuf::new() => "must be given",
        /// Join parts of divided recordings as they are: in the given order, whether or not others are missing.
        partial: bool = false,
        /// How datasets of other programs are opened: map, camera, flip, split, … by name; for each of the sources.
        opening: OpenOptions = OpenOptions::default() => "none",
        ..to: CopyOptions,
    }
}

impl Request for Merge {
    const NAME: &'static str = "merge";
    type Outcome = DatasetCopy;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("sources", self.sources.is_empty()), ("out", self.out.as_os_str().is_empty())])?;
        self.opening.check().map_err(wrong)?;
        self.to.check(registry)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<DatasetCopy, TaskError> {
        self.check(registry)?;
        let paths = self.paths(registry)?;
        check_distinct(&paths)?;
        let mut sources = Vec::with_capacity(paths.len());
        for source in &paths {
            sources.push(self.to.open(registry, source, &self.out, &self.opening, report)?);
        }
        check_recordings(&sources, &all(&sources)).map_err(wrong)?;
        check_alike(&sources)?;
        for other in beside_parts(&sources) {
            report.note(&Message::new(format!(
                "{} is no part of the recording that the other datasets are parts of; it is joined at its place in the list",
                other.display()
            )));
        }
        let sources = if self.partial { sources } else { arrange(sources).map_err(wrong)? };
        let mut sources = apart(report, move || fill_factors(sources, registry))??;
        let pieces = all(&sources);
        self.to.check_rate(&mut sources, &pieces, report)?;
        self.to.copy(registry, &sources, &pieces, Target { setting: "out", path: &self.out }, report)
    }
}

impl Merge {
    /// The datasets: those that are named, and those in folders of parts.
    fn paths(&self, registry: &Registry) -> Result<Vec<PathBuf>, TaskError> {
        let mut paths = Vec::with_capacity(self.sources.len());
        for source in &self.sources {
            check_exists(source)?;
            let parts = datasets_in(registry, source)?;
            paths.extend(if parts.is_empty() { vec![source.clone()] } else { parts });
        }
        match paths == self.sources && paths.len() == 1 {
            true => Err(wrong("one dataset was given; name two or more, or a folder of parts")),
            false => Ok(paths),
        }
    }
}

/// Refuses a path where nothing is.
pub(in super::super) fn check_exists(path: &Path) -> Result<(), TaskError> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound && !is_remote(path) => {
            Err(wrong(DataError::io(path, "open", error)))
        }
        // What else is in the way is found when it is opened.
        _ => Ok(()),
    }
}

/// Refuses to read a dataset twice, by whatever paths and links it is named.
fn check_distinct(paths: &[PathBuf]) -> Result<(), TaskError> {
    for (index, path) in paths.iter().enumerate() {
        if let Some(other) = paths[..index].iter().find(|other| is_same(other, path)) {
            let named = match other == path {
                true => format!("{} is named twice", path.display()),
                false => format!("{} and {} are the same dataset", other.display(), path.display()),
            };
            return Err(wrong(format!(
                "{named}; every episode of it would be in the result twice: name it once"
            )));
        }
    }
    Ok(())
}
