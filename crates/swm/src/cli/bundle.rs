//! `swm bundle`: a result and all it takes to repeat it, in one folder.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;
use swm_tasks::request::{MakeBundle, Request as _};

use super::output::counted;
use super::{Failure, Output};

/// Put a result and all it takes to repeat it into one folder.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm bundle results/cem --out cem-bundle
  swm bundle results/lewm --out lewm-bundle --license mit --reported 96 --source 'arXiv 2603.19312, table 2'
  swm verify-result cem-bundle

The folder has the manifest with its starts and goals, the receipt, the files of the model with a card, versions, a README and the \
SHA-256 of every file. `swm verify-result` repeats it wherever this program is installed: neither the dataset nor the run is needed.")]
pub(super) struct BundleCommand {
    /// The receipt, or the folder that holds it.
    #[arg(value_name = "RESULT")]
    result: PathBuf,
    /// The folder to write; it must not be there.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,
    /// License of the model by its SPDX identifier, such as mit.
    #[arg(long, value_name = "ID")]
    license: Option<String>,
    /// A published success rate of the same policy on the same task, in percent: `swm board` shows both.
    #[arg(long, value_name = "PERCENT")]
    reported: Option<f64>,
    /// Where that is published.
    #[arg(long, value_name = "TEXT")]
    source: Option<String>,
}

impl BundleCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Self { result, out, license, reported, source } = self;
        let request = MakeBundle { result, out, license, reported, source };
        let made = request.run(registry, &mut &*output)?;
        output.result(&made, || {
            let (folder, megabytes) = (made.bundle.display(), made.bytes as f64 / 1e6);
            let policy = match made.is_foreign {
                true => "; its policy is an object of Python: `swm.verify(FOLDER, policy=…)` verifies it",
                false => "",
            };
            format!("wrote {folder}: {}, {megabytes:.1} MB{policy}\n", counted(made.files, "file"))
        })
    }
}
