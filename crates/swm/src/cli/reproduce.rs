//! `swm reproduce`: a published result, repeated and compared with what was reported.
//!
//! Without the feature `baselines` the command is there and says how to build it.

use std::path::PathBuf;

use clap::Args;

use super::threads::ThreadsArg;

/// Repeat a published result: find its checkpoint, evaluate it, and compare with the reported rates.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm reproduce
  swm reproduce lewm-pusht --check
  swm reproduce lewm-pusht --folder downloads --figure moderate --out lewm-pusht
  swm reproduce lewm-pusht --folder downloads --pairs 10 --out quick

Without a name it lists what can be repeated. What is needed is looked for in --folder and in local caches; what is missing is listed with \
the commands that fetch it, and nothing is fetched without --fetch. An interrupted reproduction continues when the same command runs again.")]
pub(super) struct ReproduceCommand {
    /// The result: a name of the list.
    name: Option<String>,
    /// A recipe of the same form in a file, in place of a name.
    #[arg(long, value_name = "FILE", conflicts_with = "name", hide = true)]
    recipe: Option<PathBuf>,
    /// The folder that downloads lie in. Default: $STABLEWM_HOME, or ~/.stable_worldmodel.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Fetch what is missing into that folder, by the programs hf and curl.
    #[arg(long)]
    fetch: bool,
    /// The checkpoint: its folder or file, or hf:USER/REPO in a local cache. Default: looked for.
    #[arg(long, value_name = "FOLDER")]
    checkpoint: Option<String>,
    /// The dataset. Default: looked for.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// Only these of the reported figures, with commas.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    figure: Vec<String>,
    /// Only the first pairs of each manifest.
    #[arg(long, value_name = "N")]
    pairs: Option<usize>,
    /// Device of the networks: cpu, cuda, cuda:1 ….
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = swm_tasks::request::NUM_ENVS)]
    num_envs: usize,
    #[command(flatten)]
    threads: ThreadsArg,
    /// The folder for the run, the manifests, the receipts and the table.
    #[arg(long, short, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Evaluate again what the folder holds already.
    #[arg(long)]
    again: bool,
    /// Look for what is needed, and do nothing.
    #[arg(long = "check", conflicts_with = "out")]
    check: bool,
}

#[cfg(feature = "baselines")]
mod work {
    use serde_json::json;
    use swm_checkpoints::reproduce::{Need, Reproduce, Reproduced, recipes};
    use swm_core::Registry;
    use swm_tasks::request::Request as _;

    use super::ReproduceCommand;
    use crate::cli::output::{key_values, table};
    use crate::cli::reporter::Reporter;
    use crate::cli::words::Renamed;
    use crate::cli::{Failure, Output, interrupt};

    /// What has no option, or one of another name.
    const WORDS: Renamed = Renamed(&[("name", "the name of a result"), ("check_only", "--check")]);

    impl ReproduceCommand {
        pub(in crate::cli) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
            if self.name.is_none() && self.recipe.is_none() {
                return list(output);
            }
            let request = Reproduce {
                name: self.name.unwrap_or_default(),
                recipe: self.recipe,
                folder: self.folder,
                fetch: self.fetch,
                checkpoint: self.checkpoint,
                dataset: self.dataset,
                figure: self.figure,
                pairs: self.pairs,
                device: self.device,
                num_envs: self.num_envs,
                threads: self.threads.count(),
                out: self.out.unwrap_or_default(),
                again: self.again,
                check_only: self.check,
            };
            let cancel = interrupt::watch(|| "the same command continues it".to_owned());
            let done = request.run(registry, &mut Reporter::new(output, cancel));
            let done = done.map_err(|error| WORDS.failure(error))?;
            output.result(&done, || text(&done))
        }
    }

    fn list(output: &Output) -> Result<(), Failure> {
        let all = recipes();
        let rows = all.iter().map(|recipe| {
            let figures: Vec<String> = recipe
                .figures
                .iter()
                .map(|figure| {
                    let std = figure.std.map_or(String::new(), |std| format!(" ± {std:.2}"));
                    format!("{} {:.2}{std}", figure.name, figure.reported)
                })
                .collect();
            vec![
                recipe.name.clone(),
                recipe.env.clone(),
                recipe.checkpoint.repository.clone(),
                figures.join(", "),
            ]
        });
        output.result(&json!(all), || {
            table(&["name", "environment", "checkpoint", "reported success in percent"], rows)
        })
    }

    fn text(done: &Reproduced) -> String {
        let needs: Vec<(&str, String)> = done.needs.iter().map(|need| (need.what, place(need))).collect();
        if done.run.is_none() {
            return format!("{}, below {}\n\n{}", done.recipe, done.folder.display(), key_values(&needs));
        }
        let rows = done.rows.iter().map(|row| {
            let [low, high] = row.ours.ci95;
            let with_std = |rate: f64, std: Option<f64>| {
                std.map_or_else(|| format!("{rate:.1}"), |std| format!("{rate:.1} ± {std:.1}"))
            };
            let receipts: Vec<String> =
                row.repetitions.iter().map(|one| one.receipt.display().to_string()).collect();
            vec![
                row.figure.clone(),
                row.ours.episodes.to_string(),
                format!("{} ({low:.1} to {high:.1})", with_std(row.ours.success_rate, row.std)),
                with_std(row.reported, row.reported_std),
                format!("{:+.1}", row.difference),
                receipts.join(" "),
            ]
        });
        let head = ["figure", "pairs", "ours in percent (95 %)", "reported", "difference", "receipts"];
        let mut text = format!("{}: {}\n\n{}\n", done.recipe, done.env, table(&head, rows));
        for row in &done.rows {
            text += &format!("{}: {}; reported in {}\n", row.figure, row.protocol, row.source);
        }
        if let Some(file) = &done.file {
            text += &format!("wrote {}\n", file.display());
        }
        text
    }

    fn place(need: &Need) -> String {
        need.found.clone().unwrap_or_else(|| format!("missing: {}", need.advice()))
    }
}
