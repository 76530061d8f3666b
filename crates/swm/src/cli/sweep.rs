//! `swm sweep`: does a policy generalize to changed factors of variation?

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use swm_core::{Cancel, Manifest, Registry};
use swm_tasks::request::{note_rewards_only, note_training_on};

use super::args::{PartArgs, WorldArgs, policy_args, policy_files};
use super::output::{claim, create_folder, table};
use super::rates::{at_reset, p_value, rate};
use super::work::Plan;
use super::{Failure, Output, interrupt, usage};
use crate::evaluation::{
    Candidate, CellLedger, Change, Division, RunOptions, Sweep, SweepRun, Values, changes, env_of,
    grid_points, held_sweep, read_manifest, write_sweep,
};

/// Evaluate a policy under every factor of variation, one by one, by group and together.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm sweep --manifest pusht-strict.toml --policy cem --out sweep
  swm sweep --manifest pusht-strict.toml --policy weak --factors block,agent.color --values extremes --json
  swm sweep --manifest pusht-strict.toml --policy weak --factors agent.scale --values grid --points 7
  swm sweep --manifest pusht-strict.toml --policy weak --factors agent.shape,block.scale,agent.shape+block.scale
  swm sweep --manifest pusht-strict.toml --policy cem --out sweep --shard 3/64    (one of 64 parts; then --join in place of it)

Each factor that is named alone, each group of which all are named, what is joined by `+` together, and with `--factors all` all together, on the pairs \
of the manifest, against the unchanged environment. With --out, \
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
    #[arg(long, default_value_t = 0, value_name = "SEED")]
    policy_seed: u64,
    /// Factors: names, groups, or `all`, separated by commas; `NAME+NAME` changes several together.
    #[arg(long, default_value = "all", value_delimiter = ',', value_name = "NAMES")]
    factors: Vec<String>,
    /// Which values they get.
    #[arg(long, value_enum, default_value_t)]
    values: ValuesArg,
    /// With --values grid: how many. Default: 5, or every value where the factors are choices of up to 16.
    #[arg(long)]
    points: Option<usize>,
    #[command(flatten)]
    pub(super) world: WorldArgs,
    /// A folder for sweep.json, sweep.csv and sweep.svg.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --out: run again what the folder holds already, and replace it.
    #[arg(long, requires = "out")]
    again: bool,
    #[command(flatten)]
    part: PartArgs,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum ValuesArg {
    /// Sampled for every episode.
    #[default]
    Sampled,
    /// The smallest, then the largest.
    Extremes,
    /// Evenly from the smallest to the largest.
    Grid,
}

/// One policy in all cells; each cell's changes are tried once in a part that has some of its pairs.
const DIVISION: Division = Division::ByCell;

impl SweepCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        match self.sweep(registry, output)? {
            Some(sweep) => output.result(&sweep, || text(&sweep, self.out.as_deref())),
            None => Ok(()),
        }
    }

    /// That of `policy`, for a command that does several.
    pub(super) fn of(
        manifest: &Path,
        policy: &str,
        factors: &[String],
        world: &WorldArgs,
        out: PathBuf,
    ) -> Self {
        Self {
            manifest: manifest.to_owned(),
            policy: policy.to_owned(),
            policy_seed: 0,
            factors: factors.to_vec(),
            values: ValuesArg::default(),
            points: None,
            world: world.clone(),
            out: Some(out),
            again: false,
            part: PartArgs::default(),
        }
    }

    /// What comes of it; nothing where it was a part.
    pub(super) fn sweep(&self, registry: &Registry, output: &Output) -> Result<Option<Sweep>, Failure> {
        let (manifest, candidate, values, changes) = self.asked(registry)?;
        let entry = env_of(registry, &manifest).map_err(usage)?;
        note_rewards_only(entry, &manifest.success, &mut &*output);
        note_training_on(registry, entry, &manifest, &candidate.policy, &mut &*output);
        let options = RunOptions { cancel: Some(self.watch()), ..self.world.run_options() };
        let mut run = SweepRun::new(registry, &manifest, &candidate, changes.clone(), values, options)?;
        let (cells, pairs) = (run.cells(), run.pairs());
        // Shards write parts of their own.
        let whole = self.out.as_ref().filter(|_| self.part.shard.is_none());
        let claimed = |dir: &PathBuf| create_folder(dir).and_then(|()| claim(&dir.join("sweep.json")));
        let _claim = whole.map(claimed).transpose()?;
        if let Some(dir) = &self.out {
            create_folder(dir)?;
            if !self.again
                && let Some(held) = held_sweep(
                    dir,
                    &manifest,
                    &candidate,
                    &candidate.files(registry, entry)?,
                    values,
                    &changes,
                )?
            {
                output.note(format!("{}: already done; --again repeats it", dir.display()));
                return Ok(Some(held));
            }
        }
        let bar = output.bar(cells, "evaluations");
        let told = |name: &str| {
            bar.inc(1);
            bar.set_message(name.to_owned());
        };
        let mut ledger = match (&self.out, self.part.shard) {
            (None, _) => CellLedger::in_memory(cells, pairs),
            (Some(dir), Some(shard)) => {
                let mut ledger =
                    CellLedger::open_part(dir, shard.numbers(), DIVISION, &run.identity()?, cells, pairs)?;
                let done = run.run_part(&mut ledger, None, told);
                bar.finish_and_clear();
                done?;
                ledger.finish_part()?;
                let episodes = shard.of(cells * pairs);
                self.part.done(Some(dir), shard, episodes.end - episodes.start, output)?;
                return Ok(None);
            }
            (Some(dir), None) if self.part.join => {
                CellLedger::join(dir, DIVISION, &run.identity()?, cells, pairs)?
            }
            (Some(dir), None) => CellLedger::open(&dir.join("sweep.jsonl"), &run.identity()?, cells, pairs)?,
        };
        let result = run.run(&mut ledger, None, |cell| told(&cell.name));
        bar.finish_and_clear();
        let result = result?;
        if let Some(dir) = &self.out {
            write_sweep(dir, &result)?;
        }
        ledger.close()?;
        Ok(Some(result))
    }
}

impl SweepCommand {
    /// What is asked for.
    fn asked(&self, registry: &Registry) -> Result<(Manifest, Candidate, Values, Vec<Change>), Failure> {
        let manifest = read_manifest(&self.manifest).map_err(usage)?;
        if self.world.frame_skip.is_some() {
            return Err(usage("--frame-skip: the manifest says how often actions are applied"));
        }
        let entry = env_of(registry, &manifest).map_err(usage)?;
        let candidate = Candidate::new(policy_args(&self.policy)?).seeded(self.policy_seed);
        let candidate = candidate.on(registry, entry, &manifest);
        if self.points.is_some() && !matches!(self.values, ValuesArg::Grid) {
            return Err(usage("--points is for --values grid; give both"));
        }
        let config = swm_core::EnvConfig { image: None, settings: manifest.settings.clone() };
        let factors = entry.make(&config)?.spec().factors.clone();
        let values = match self.values {
            ValuesArg::Sampled => Values::Sampled,
            ValuesArg::Extremes => Values::Extremes,
            ValuesArg::Grid => {
                Values::Grid(self.points.unwrap_or_else(|| grid_points(&factors, &self.factors)))
            }
        };
        candidate.make(registry, entry, &manifest)?;
        let changes = changes(&factors, &self.factors, values).map_err(usage)?;
        Ok((manifest, candidate, values, changes))
    }

    /// What a job needs to know before it is submitted.
    pub(super) fn plan(&self, registry: &Registry) -> Result<Plan, Failure> {
        let (manifest, _, _, changes) = self.asked(registry)?;
        let mut inputs = vec![self.manifest.clone()];
        inputs.extend(policy_files(registry, env_of(registry, &manifest).map_err(usage)?, &self.policy)?);
        Ok(Plan { episodes: (changes.len() as u64 + 1) * manifest.pairs.len() as u64, inputs })
    }

    /// What ends the sweep when the command is interrupted.
    fn watch(&self) -> Cancel {
        match &self.out {
            Some(dir) => interrupt::watch_resumable(interrupt::episodes_are_in(dir), interrupt::REPEAT),
            None => interrupt::watch(|| {
                "nothing is kept of this sweep; with --out DIR it can be continued".to_owned()
            }),
        }
    }
}

/// A note without its reason.
fn short(note: &str) -> &str {
    note.split_once(": ").map_or(note, |(short, _)| short)
}

/// Reasons, which are longer than a line of the table; each once, with the changes that it holds for.
fn reasons(sweep: &Sweep) -> Vec<(&str, Vec<String>)> {
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

fn text(sweep: &Sweep, out: Option<&Path>) -> String {
    let rows: Vec<Vec<String>> = sweep
        .cells
        .iter()
        .map(|cell| {
            let (difference, p) = cell.test.as_ref().map_or((String::new(), String::new()), |test| {
                let [low, high] = test.interval95;
                (format!("{:+.1} ({low:+.1} to {high:+.1})", test.difference), p_value(test.p_value))
            });
            let result = cell.summary.as_ref().map_or("–".to_owned(), rate);
            vec![
                cell.name.clone(),
                cell.value.clone(),
                result,
                difference,
                p,
                cell.note.as_deref().map_or("", short).to_owned(),
            ]
        })
        .collect();
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
        table(&["changed", "values", "success (95 %)", "difference (95 %)", "McNemar", ""], &rows)
    )
}
