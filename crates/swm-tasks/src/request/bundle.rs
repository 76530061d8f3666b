//! A result and all it takes to repeat it are put into one folder.

use std::path::PathBuf;

use serde::Serialize;
use swm_core::Registry;

use super::{Fix, Message, Report, Request, TaskError, create_parent, must_be_given, wrong};
use crate::bundle::{Bundle, Reported, bundle_of, write_bundle};
use crate::evaluation::{file_bytes, read_receipt};

swm_core::settings! {
    /// Put a result and all it takes to repeat it into one folder.
    pub struct MakeBundle {
        /// The receipt, or the folder that holds it.
        result: PathBuf = PathBuf::new() => "must be given",
        /// The folder to write; it must not be there.
        out: PathBuf = PathBuf::new() => "must be given",
        /// License of the model by its SPDX identifier, such as `mit`.
        license: Option<String> = None => "none",
        /// A published success rate of the same policy on the same task, in percent.
        reported: Option<f64> = None => "none",
        /// Where that is published.
        source: Option<String> = None => "none",
    }
}

/// A bundle that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Bundled {
    /// Its folder.
    pub bundle: PathBuf,
    /// Files in it.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// SHA-256 of the list of hashes: the name of its content.
    pub hash: String,
    /// Whether the policy is an object of another program, which has to be given to verify it.
    pub is_foreign: bool,
}

impl Request for MakeBundle {
    const NAME: &'static str = "bundle";
    type Outcome = Bundled;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[
            ("result", self.result.as_os_str().is_empty()),
            ("out", self.out.as_os_str().is_empty()),
        ])?;
        if self.out.file_name().is_none() {
            let out = self.out.display().to_string();
            return Err(Message::about("out", out, "names no new folder").fix(Fix::Change("out")).into());
        }
        if let Some(rate) = self.reported.filter(|rate| !(0.0..=100.0).contains(rate)) {
            // JSON has no NaN.
            let message = Message::about("reported", rate.to_string(), "is in percent; use 0 to 100");
            return Err(message.into());
        }
        if let (Some(source), None) = (&self.source, self.reported) {
            let message =
                Message::about("source", source.as_str(), "is about a reported rate, and none is given");
            let fix = Fix::Any(vec![Fix::give("reported"), Fix::Leave("source")]);
            return Err(message.fix(fix).into());
        }
        for (name, text) in [("license", &self.license), ("source", &self.source)] {
            if let Some(text) =
                text.as_deref().filter(|text| text.trim().is_empty() || text.contains(['\n', '\r']))
            {
                return Err(Message::about(name, text, "must be one line of text").into());
            }
        }
        if std::fs::symlink_metadata(&self.out).is_ok() {
            let text = format!("{} exists, and a bundle is never changed", self.out.display());
            return Err(Message::new(text).fix(Fix::Change("out")).into());
        }
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Bundled, TaskError> {
        self.check(registry)?;
        if let Some(folder) = bundle_of(&self.result) {
            return Err(wrong(format!("{} is a bundle already; copy the folder", folder.display())));
        }
        let receipt = read_receipt(&self.result).map_err(wrong)?;
        create_parent(&self.out)?;
        if self.license.is_none() && !receipt.files.is_empty() {
            let message = Message::new("the bundle holds a model, and nothing names its license");
            report.note(&message.fix(Fix::set("license", "mit")));
        }
        let reported =
            self.reported.map(|success_rate| Reported { success_rate, source: self.source.clone() });
        write_bundle(registry, &receipt, &self.out, self.license.clone(), reported)?;
        let Bundle { info, files, hash, .. } = Bundle::open(&self.out)?;
        let bytes = file_bytes(&self.out).map_err(|error| error.source)?;
        Ok(Bundled { bundle: self.out.clone(), files, bytes, hash, is_foreign: info.is_foreign })
    }
}

#[cfg(test)]
mod tests;
