//! `swm robustness`: trainings of several seeds under every change, beside the oracle and what is published.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;
use swm_tasks::request::{self, ManifestSource, NUM_ENVS, Request as _, Swept, make_folder};

use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output, interrupt, usage};
use crate::evaluation::{ROBUST_TASKS, RobustTask, Robustness, Sweep, read_manifest};

/// Evaluate trainings of several seeds under changed factors, and make the table of a paper of it.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm robustness pusht --manifest historic.toml --policy mpc:one,canonical=c1 --policy mpc:two,canonical=c2 --oracle cem --out table
  swm robustness pusht --manifest historic.toml --policy gcsl:one --factors background.color,agent.color --out table

A sweep of each policy, in sweeps/ in --out, then one table: robustness.json, robustness.md and robustness.svg. Where the same command \
was interrupted, it continues; what is done is not repeated. The task names the published figures beside it.")]
pub(super) struct RobustnessCommand {
    /// The task: pusht.
    task: String,
    /// The manifest; `swm manifest make` makes one.
    #[arg(long, value_name = "FILE")]
    manifest: PathBuf,
    /// A policy; repeated for trainings of other seeds.
    #[arg(long, required = true)]
    policy: Vec<String>,
    /// A policy on the true dynamics, for what is possible at all: cem, with its settings.
    #[arg(long, value_name = "POLICY")]
    oracle: Option<String>,
    /// Factors: names, groups, or `all`, separated by commas; `NAME+NAME` changes several together.
    #[arg(long, default_value = "all", value_delimiter = ',', value_name = "NAMES")]
    factors: Vec<String>,
    /// Environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = NUM_ENVS, value_name = "K")]
    num_envs: usize,
    #[command(flatten)]
    threads: ThreadsArg,
    /// A folder for the table and its sweeps.
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
}

impl RobustnessCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let manifest = read_manifest(&self.manifest).map_err(usage)?;
        let task = self.task()?;
        if manifest.env != task.env {
            return Err(usage(format!(
                "{}: its environment is {}, and {} is a task of {}; make a manifest of that one",
                self.manifest.display(),
                manifest.env,
                task.name,
                task.env
            )));
        }
        make_folder(&self.out)?;
        let sweep = |name: &str, policy: &str| -> Result<Sweep, Failure> {
            output.note(format!("{name}: {policy}"));
            let out = self.out.join("sweeps").join(name);
            let cancel = interrupt::watch_resumable(interrupt::episodes_are_in(&out), interrupt::REPEAT);
            let request = request::Sweep {
                manifest: Some(ManifestSource::File(self.manifest.clone())),
                policy: policy.to_owned(),
                factors: self.factors.clone(),
                num_envs: self.num_envs,
                threads: self.threads.count(),
                out: Some(out),
                ..request::Sweep::default()
            };
            match request.run(registry, &mut Reporter::new(output, cancel))? {
                Swept::Sweep(sweep) => Ok(*sweep),
                _ => Err(format!("{}: no sweep came of it", self.manifest.display()).into()),
            }
        };
        let numbered = (1..).zip(&self.policy);
        let sweeps: Vec<Sweep> =
            numbered.map(|(number, policy)| sweep(&number.to_string(), policy)).collect::<Result<_, _>>()?;
        let oracle = self.oracle.as_ref().map(|policy| sweep("oracle", policy)).transpose()?;
        let table = Robustness::join(&sweeps, oracle.as_ref(), Some(task.published))?;
        table.write(&self.out, &sweeps)?;
        output
            .result(&table, || format!("{}\n{}", table.markdown(), self.out.join("robustness.md").display()))
    }

    fn task(&self) -> Result<&'static RobustTask, Failure> {
        ROBUST_TASKS.iter().find(|task| task.name == self.task).ok_or_else(|| {
            let known: Vec<&str> = ROBUST_TASKS.iter().map(|task| task.name).collect();
            usage(format!("unknown task `{}`; there is {}", self.task, known.join(", ")))
        })
    }
}
