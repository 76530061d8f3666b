//! A dataset is copied into another format.

use std::path::PathBuf;

use swm_core::Registry;
use swm_data::OpenOptions;
use swm_data::tools::copy::all;

use super::super::{Report, Request, TaskError, must_be_given, wrong};
use super::{CopyOptions, DatasetCopy, Target};

swm_core::settings! {
    /// DatasetCopy a dataset into another format.
    pub struct Convert {
        /// The dataset to copy.
        source: PathBuf = PathBuf::new() => "must be given",
        /// The file or folder to write.
        target: PathBuf = PathBuf::new() => "must be given",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        ..to: CopyOptions,
    }
}

impl Request for Convert {
    const NAME: &'static str = "convert";
    type Outcome = DatasetCopy;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[
            ("source", self.source.as_os_str().is_empty()),
            ("target", self.target.as_os_str().is_empty()),
        ])?;
        self.opening.check().map_err(wrong)?;
        self.to.check(registry)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<DatasetCopy, TaskError> {
        self.check(registry)?;
        let mut sources = vec![self.to.open(registry, &self.source, &self.target, &self.opening, report)?];
        let pieces = all(&sources);
        self.to.check_rate(&mut sources, &pieces, report)?;
        let target = Target { setting: "target", path: &self.target };
        self.to.copy(registry, &sources, &pieces, target, report)
    }
}
