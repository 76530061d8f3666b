//! `swm import`: a run of a checkpoint that others published.
//!
//! Without the feature `baselines` the command is there and prints how to build it.

use std::path::PathBuf;

use clap::Args;

use super::opening::DataArgs;

/// Make a run of a published checkpoint: of stable-worldmodel, or of the authors of DINO-WM.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm import lewm-pusht --check
  swm import lewm-pusht --env swm/PushT-v1 --dataset pusht.h5 --out runs/lewm
  swm import hf:quentinll/lewm-pusht --env swm/PushT-v1 --stats pusht.h5.stats.json --out runs/lewm
  swm import outputs/dino --env swm/PushT-v1 --dataset pusht.h5 --encoder dinov2_vits14_pretrain.pth --out runs/dino
  swm eval swm/PushT-v1 --policy mpc:runs/lewm

The run is one like any other: mpc:RUN, quality, sweep and receipts take it. Nothing of a config or a pickle is executed, and nothing is \
fetched: hf:USER/REPO looks into local caches. How actions were scaled is in no file of a checkpoint, so that it must be given.")]
pub(super) struct Import {
    /// The checkpoint: its folder, its file of weights, or hf:USER/REPO in a local cache.
    from: String,
    /// What it is, where no file says so: lewm, pldm, dino-wm, gcbc, gciql, gcivl, hilp or tdmpc2.
    #[arg(long = "as", value_name = "MODEL")]
    kind: Option<String>,
    /// Of several files of weights in the folder, this one.
    #[arg(long = "weights", value_name = "NAME")]
    file: Option<String>,
    /// A file with the weights of its frozen encoder, where it has them not itself.
    #[arg(long, value_name = "FILE")]
    encoder: Option<PathBuf>,
    /// The environment's id; `swm envs` lists them. Default: the dataset's.
    #[arg(long, value_name = "ID")]
    env: Option<String>,
    /// A setting of the environment, `NAME=VALUE`; may be repeated.
    #[arg(long = "env-option", value_name = "NAME=VALUE", requires = "env")]
    env_options: Vec<String>,
    /// The dataset that it was trained on: it says how vectors were scaled, and which environment it is.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// A file of statistics in place of a dataset, such as `swm stats` writes.
    #[arg(long, value_name = "FILE", conflicts_with = "dataset")]
    stats: Option<PathBuf>,
    /// Means of actions, with commas.
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',', allow_hyphen_values = true)]
    action_mean: Option<Vec<f64>>,
    /// Stds of actions, with commas.
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    action_std: Option<Vec<f64>>,
    /// Means of `proprio`, or of the vector that an agent observes, with commas.
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',', allow_hyphen_values = true)]
    proprio_mean: Option<Vec<f64>>,
    /// Stds of the same, with commas.
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',')]
    proprio_std: Option<Vec<f64>>,
    /// Side of its images in pixels. Default: as its files say.
    #[arg(long, value_name = "PIXELS")]
    image: Option<usize>,
    /// A setting of the model, `NAME=VALUE`, such as `model.encoder.heads=6`; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// The run's folder.
    #[arg(long, short, value_name = "RUN", required_unless_present = "check")]
    out: Option<PathBuf>,
    /// Read and describe it, with what must still be given; write nothing.
    #[arg(long, conflicts_with = "out")]
    check: bool,
    #[command(flatten)]
    opening: DataArgs,
}

#[cfg(feature = "baselines")]
mod work {
    use swm_checkpoints::import::{Description, Import as Request};
    use swm_core::Registry;
    use swm_tasks::request::Request as _;

    use super::Import;
    use crate::cli::args::{assignments, json_value};
    use crate::cli::output::key_values;
    use crate::cli::words::Renamed;
    use crate::cli::{Failure, Output};

    /// What has options of other names.
    const WORDS: Renamed = Renamed(&[
        ("check_only", "--check"),
        ("kind", "--as"),
        ("file", "--weights"),
        ("env", "--env"),
        ("from", "its folder or file"),
    ]);

    impl Import {
        pub(in crate::cli) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
            let request = Request {
                env_option: assignments(&self.env_options, "--env-option", json_value)?,
                set: assignments(&self.set, "--set", json_value)?,
                from: self.from,
                kind: self.kind,
                file: self.file,
                encoder: self.encoder,
                env: self.env,
                opening: self.opening.options_of(self.dataset.as_ref())?,
                dataset: self.dataset,
                stats: self.stats,
                action_mean: self.action_mean,
                action_std: self.action_std,
                proprio_mean: self.proprio_mean,
                proprio_std: self.proprio_std,
                image: self.image,
                out: self.out.unwrap_or_default(),
                check_only: self.check,
            };
            let found = request.run(registry, &mut &*output).map_err(|error| WORDS.failure(error))?;
            output.result(&found, || text(&found))
        }
    }

    fn text(found: &Description) -> String {
        let Description { tensors: [fit, all], .. } = found;
        let mut rows = vec![("model".to_owned(), found.model.clone())];
        let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
        if *all > 0 {
            row("tensors", format!("{fit} of {all}"));
        }
        if !found.format.is_empty() {
            row("file", format!("{}, names of {}", found.format, found.names));
        }
        if found.image > 0 {
            row("image", format!("{0} x {0}", found.image));
        }
        row("history", found.history.to_string());
        row("numbers a block", found.block.to_string());
        if let Some(frameskip) = found.frameskip {
            row("actions a block", frameskip.to_string());
        }
        if let Some(env) = &found.env {
            row("environment", env.clone());
        }
        for (name, scale, from) in &found.scales {
            row(&format!("scale of {name}"), format!("mean {:?}, std {:?} ({from})", scale.mean, scale.std));
        }
        if let Some(hash) = &found.sha256 {
            row("sha256", hash.clone());
        }
        if let Some(known) = &found.known {
            row("known", known.clone());
        }
        if !found.lacks.is_empty() {
            row("random", format!("{} tensors that no plan or action needs", found.lacks.len()));
        }
        for missing in &found.missing {
            row("missing", missing.in_words(&WORDS));
        }
        if let Some(run) = &found.run {
            row("run", run.display().to_string());
        }
        let rows: Vec<(&str, String)> =
            rows.iter().map(|(name, value)| (name.as_str(), value.clone())).collect();
        key_values(&rows)
    }

    #[cfg(test)]
    mod tests {
        use swm_tasks::request::{Fix, Message};

        use super::*;

        #[test]
        fn what_is_missing_is_worded_as_options() {
            let mut found = Description::default();
            found.missing = vec![Message::new("it has no scale").fix(Fix::give("action_mean"))];
            let shown = text(&found);
            assert!(shown.contains("it has no scale; give --action-mean"), "{shown}");
            assert!(!shown.contains("image"), "an agent of vectors sees none: {shown}");
        }
    }
}
