//! `swm sweep`: does a policy generalize to changed factors of variation?

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use swm_core::Registry;
use swm_tasks::evaluation;
use swm_tasks::request::{Fix, ManifestSource, Message, Request as _, Sweep, Swept, TaskError};

use super::args::{PartArgs, WorldArgs, part_done};
use super::output::table;
use super::rates::{at_reset, difference, rate};
use super::reporter::Reporter;
use super::{Failure, Output, interrupt};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<Sweep> = LazyLock::new(Sweep::default);

/// Evaluate a policy under every factor of variation, one by one, by group and together.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm sweep --manifest pusht-strict.toml --policy cem --out sweep
  swm sweep --manifest pusht-strict.toml --policy weak --factors block,agent.color --values extremes --json
  swm sweep --manifest pusht-strict.toml --policy weak --factors agent.scale --values grid --points 7
  swm sweep --manifest pusht-strict.toml --policy weak --factors agent.shape,block.scale,agent.shape+block.scale
  swm sweep --manifest pusht-strict.toml --policy cem --out sweep --shard 3/64    (one of 64 parts; then --join in place of it)

Runs one evaluation per factor, per group whose factors are all named, and per `NAME+NAME`, on the pairs of the manifest; `--factors all` adds one with \
every factor. Each is compared with the unchanged environment. With --out, \
the folder gets sweep.json, sweep.csv and sweep.svg; `swm report` shows it with other results. An interrupted sweep continues \
where it stopped. Parts write to parts/ in --out; joined, they are the undivided sweep.")]
pub(super) struct SweepCommand {
    /// The manifest; `swm manifest make` makes one.
    #[arg(long, value_name = "FILE")]
    manifest: PathBuf,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long)]
    policy: String,
    /// Seed of the policy's noise.
    #[arg(long, default_value_t = DEFAULT.policy_seed, value_name = "SEED")]
    policy_seed: u64,
    /// Factors: names, groups, or `all`, separated by commas; `NAME+NAME` changes several together.
    #[arg(long, default_value = "all", value_delimiter = ',', value_name = "NAMES")]
    factors: Vec<String>,
    /// Which values they get.
    #[arg(long, value_parser = values(), default_value_t = DEFAULT.values.clone())]
    values: String,
    /// With --values grid: how many. Default: 5, or every value where the factors are choices of up to 16.
    #[arg(long)]
    points: Option<usize>,
    #[command(flatten)]
    world: WorldArgs,
    /// A folder for sweep.json, sweep.csv and sweep.svg.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --out: run again what the folder holds already, and replace it.
    #[arg(long, requires = "out")]
    again: bool,
    #[command(flatten)]
    part: PartArgs,
}

impl SweepCommand {
    /// What is asked for.
    pub(super) fn request(&self) -> Result<Sweep, Failure> {
        if let Some(given) = self.world.frame_skip {
            let message = Message::about("frame_skip", given, "the manifest fixes it");
            return Err(TaskError::from(message.fix(Fix::Leave("frame_skip"))).into());
        }
        Ok(Sweep {
            manifest: Some(ManifestSource::File(self.manifest.clone())),
            policy: self.policy.clone(),
            policy_seed: self.policy_seed,
            plan_steps: None,
            factors: self.factors.clone(),
            values: self.values.clone(),
            points: self.points,
            num_envs: self.world.num_envs,
            threads: self.world.threads.count(),
            out: self.out.clone(),
            again: self.again,
            shard: self.part.shard,
            join: self.part.join,
        })
    }

    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        run(&self.request()?, registry, output)
    }
}

/// Sweeps, and prints what came out.
pub(super) fn run(request: &Sweep, registry: &Registry, output: &Output) -> Result<(), Failure> {
    let out = request.out.as_deref();
    let cancel = match out {
        Some(dir) => interrupt::watch_resumable(interrupt::episodes_are_in(dir), interrupt::REPEAT),
        None => interrupt::watch(|| {
            "nothing is kept of this sweep; with --out DIR it can be continued".to_owned()
        }),
    };
    match request.run(registry, &mut Reporter::new(output, cancel))? {
        Swept::Sweep(sweep) => output.result(&sweep, || text(&sweep, out)),
        Swept::Part(shard, episodes) => part_done(out, shard, episodes, output),
        _ => Ok(()),
    }
}

/// Which values factors get, by name.
fn values() -> PossibleValuesParser {
    [
        PossibleValue::new("sampled").help("Sampled for every episode"),
        PossibleValue::new("extremes").help("The smallest, then the largest"),
        PossibleValue::new("grid").help("Evenly from the smallest to the largest"),
    ]
    .into()
}

/// A note without its reason.
fn short(note: &str) -> &str {
    note.split_once(": ").map_or(note, |(short, _)| short)
}

/// Reasons, which are longer than a line of the table; each once, with the changes that it holds for.
fn reasons(sweep: &evaluation::Sweep) -> Vec<(&str, Vec<String>)> {
    let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
    for cell in &sweep.cells {
        let Some((_, reason)) = cell.note.as_deref().and_then(|note| note.split_once(": ")) else { continue };
        let change = format!("{} {}", cell.name, cell.value);
        match reasons.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, changes)) => changes.push(change),
            None => reasons.push((reason, vec![change])),
        }
    }
    reasons
}

fn text(sweep: &evaluation::Sweep, out: Option<&Path>) -> String {
    let rows = sweep.cells.iter().map(|cell| {
        let test = cell.test.as_ref();
        let [difference, p] =
            test.map(|test| difference(test.difference, test.interval95, test.p_value)).unwrap_or_default();
        let result = cell.summary.as_ref().map_or("–".to_owned(), rate);
        vec![
            cell.name.clone(),
            cell.value.clone(),
            result,
            difference,
            p,
            cell.note.as_deref().map_or("", short).to_owned(),
        ]
    });
    let pairs = sweep.cells[0].successes.len();
    let reasons: String =
        reasons(sweep).iter().map(|(reason, cells)| format!("{}: {reason}\n", cells.join(", "))).collect();
    let folder = out.map(|dir| format!("{}\n", dir.join("sweep.json").display())).unwrap_or_default();
    format!(
        "{}, {} tier, {pairs} pairs{}, {}\n\n{}{reasons}{folder}",
        sweep.env,
        sweep.tier,
        sweep.cells[0]
            .summary
            .as_ref()
            .map_or(String::new(), |unchanged| at_reset(unchanged.solved_at_start)),
        sweep.candidate.policy,
        table(&["changed", "values", "success (95 %)", "difference (95 %)", "McNemar", ""], rows)
    )
}
