//! `swm export`: a run as a checkpoint that others load.
//!
//! Without the feature `baselines` the command is there and prints how to build it.

use std::path::PathBuf;

use clap::Args;

/// Write a run as a checkpoint that stable-worldmodel's load_pretrained takes.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm export runs/lewm --out published/lewm-pusht
  swm export runs/lewm --receipt results/lewm --out published/lewm-pusht
  swm export runs/lewm --checkpoint best --transformers 5 --out published/lewm-pusht
  swm import published/lewm-pusht --out runs/again

The folder gets weights.pt and config.json, a model card (README.md), and swm.json with what no other file says: how vectors are scaled, the \
environment, all settings. With it, swm import asks for nothing. It has LeWM, PLDM, DINO-WM, GCBC, GCIQL, GCIVL, HILP and TD-MPC2 whose \
networks are the reference's.")]
pub(super) struct Export {
    /// The run's folder.
    run: PathBuf,
    /// Which checkpoint: last, best, or a step.
    #[arg(long, value_name = "WHICH", default_value = "last")]
    checkpoint: String,
    /// The version of transformers, 4 or 5, whose names the tensors of its encoder get. Default: that of the checkpoint that the run was
    /// imported from, else 4.
    #[arg(long, value_name = "VERSION")]
    transformers: Option<usize>,
    /// The receipt of an evaluation of this checkpoint, for the card: its file or folder.
    #[arg(long, value_name = "RESULT")]
    receipt: Option<PathBuf>,
    /// The folder, which must not be there yet.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,
}

#[cfg(feature = "baselines")]
mod work {
    use swm_checkpoints::export::{Export as Request, Exported};
    use swm_core::Registry;
    use swm_tasks::request::Request as _;

    use super::Export;
    use crate::cli::output::key_values;
    use crate::cli::{Failure, Output};

    impl Export {
        pub(in crate::cli) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
            let Self { run, checkpoint, transformers, receipt, out } = self;
            let request = Request { run, checkpoint, transformers, receipt, out };
            let written = request.run(registry, &mut &*output)?;
            output.result(&written, || text(&written))
        }
    }

    fn text(written: &Exported) -> String {
        let mut rows = vec![
            ("model", format!("{} ({})", written.model, written.class)),
            ("step", written.step.to_string()),
            ("tensors", written.tensors.to_string()),
        ];
        if let Some(version) = written.transformers {
            rows.push(("names", format!("transformers {version}")));
        }
        if !written.left_out.is_empty() {
            rows.push(("left out", written.left_out.join(", ")));
        }
        rows.push(("sha256", written.sha256.clone()));
        rows.push(("files", written.files.join(", ")));
        rows.push(("folder", written.folder.display().to_string()));
        key_values(&rows)
    }
}
