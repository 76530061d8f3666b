//! `swm manifest`: an evaluation task as a file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use serde_json::{Map, Value as Json, json};
use swm_core::evaluate::{ChosenPair, ManifestOptions, Tier, make_manifest};
use swm_core::{EnvConfig, EnvEntry, Manifest, Registry, SuccessRule};

use super::args::{EnvArgs, ImageArg};
use super::output::{create_parent, table};
use super::scenario::ScenarioArgs;
use super::stream::read_stream;
use super::{Failure, Output, inputs, usage};
use crate::distractors;
use crate::evaluation::{
    TierRules, holds_manifest, read_manifest, recorded_pairs, tier_rules, write_manifest,
};

/// Actions allowed per episode, online and on recorded pairs (the reference's).
const BUDGET_ONLINE: u64 = 200;
const BUDGET_DATASET: u64 = 50;

/// Define an evaluation task as a file: pairs of start and goal, budget, success rule.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm manifest make swm/PushT-v1 --dataset pusht.h5 --tier strict --episodes 100 --out pusht-strict.toml
  swm manifest make swm/TwoRoom-v2 --tier moderate --episodes 100 --out two-room.toml
  swm manifest make swm/PushT-v1 --dataset pusht.h5 --pairs 3:10-35,4:0-25 --tier historic --out two.toml
  swm manifest show pusht-strict.toml
  swm eval --manifest pusht-strict.toml --policy cem --out results")]
pub(super) struct ManifestCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Sample pairs and write a manifest: JSON if the name ends in .json, else TOML.
    #[command(
        after_help = "Examples:\n  swm manifest make swm/PushT-v1 --dataset pusht.h5 --tier strict --episodes 100 --out strict.toml\n  swm manifest make swm/PushT-v1 --dataset pusht.h5 --pairs 3:10-35,4:0-25 --tier historic --out two.toml"
    )]
    Make(Box<Make>),
    /// Show a manifest.
    #[command(after_help = "Example:\n  swm manifest show pusht-strict.toml")]
    Show {
        /// The manifest.
        manifest: PathBuf,
    },
}

#[derive(Args)]
struct Make {
    #[command(flatten)]
    env: EnvArgs,
    /// How pairs are chosen, and what counts as success.
    #[arg(long, value_enum)]
    tier: TierArg,
    /// The manifest to write.
    #[arg(long, short, value_name = "FILE")]
    out: PathBuf,
    /// Number of pairs.
    #[arg(long, default_value_t = 100)]
    episodes: usize,
    /// Seed of the pairs.
    #[arg(long, default_value_t = 42)]
    seed: u64,
    /// Take starts and goals from this dataset. Without it, the environment samples them.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// With --dataset: these pairs and no others. 3:10-35 starts at step 10 of episode 3 and has its goal at step 35; 3:10-4:0 has
    /// it at step 0 of episode 4.
    #[arg(long, value_name = "EPISODE:START-GOAL", value_delimiter = ',', requires = "dataset")]
    #[arg(conflicts_with_all = ["episodes", "goal_offset", "held_out"])]
    pairs: Option<Vec<ChosenPair>>,
    /// With --dataset: the goal is this many steps after the start.
    #[arg(long, default_value_t = 25, requires = "dataset")]
    goal_offset: usize,
    /// With --dataset and --tier moderate or strict: the fraction of episodes that is held out from training. 1: all.
    #[arg(long, default_value_t = 0.2, requires = "dataset", value_name = "SHARE")]
    held_out: f64,
    /// Actions allowed per episode. Default: 200, or 50 with --dataset.
    #[arg(long)]
    budget: Option<u64>,
    /// How often each action is applied per step. Default: 1, or the dataset's.
    #[arg(long, value_name = "F")]
    frame_skip: Option<u32>,
    /// Size of the images that policies see, or `none`.
    #[arg(long, default_value = "none")]
    image_size: ImageArg,
    /// A distractor that changes those images: NAME or NAME:KEY=VALUE,…; may be repeated.
    #[arg(long = "distractor", value_name = "NAME:ARGS")]
    distractors: Vec<String>,
    /// A TOML file with the phases of a stream: a number of episodes each, with the factors of the phase.
    #[arg(long, value_name = "FILE")]
    stream: Option<PathBuf>,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Replace an existing file.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum TierArg {
    /// As published: steps sampled uniformly, pairs with success at reset included.
    Historic,
    /// Held-out episodes, no success at reset, some motion, starts at rest.
    Moderate,
    /// More motion, and a tighter success rule.
    Strict,
}

impl From<TierArg> for Tier {
    fn from(tier: TierArg) -> Self {
        match tier {
            TierArg::Historic => Tier::Historic,
            TierArg::Moderate => Tier::Moderate,
            TierArg::Strict => Tier::Strict,
        }
    }
}

impl ManifestCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        match self.action {
            Action::Make(make) => show(&make.write(registry, output)?, &make.out, output),
            Action::Show { manifest } => {
                let found = read_manifest(&manifest).map_err(usage)?;
                show(&found, &manifest, output)
            }
        }
    }
}

/// As `swm manifest make WORDS`, and prints nothing.
#[cfg(feature = "ui")]
pub(super) fn make(registry: &Registry, words: &[String]) -> Result<Manifest, Failure> {
    use clap::FromArgMatches as _;

    let command = Make::augment_args(clap::Command::new("manifest make").no_binary_name(true));
    let matches = command.try_get_matches_from(words).map_err(usage)?;
    Make::from_arg_matches(&matches).map_err(usage)?.write(registry, &Output::new(false, true))
}

impl Make {
    /// Makes the manifest and writes it.
    fn write(&self, registry: &Registry, output: &Output) -> Result<Manifest, Failure> {
        let tier = Tier::from(self.tier);
        let entry = self.env.entry(registry)?;
        let mut dataset = self.dataset.as_deref().map(|path| inputs::open(registry, path)).transpose()?;
        if let Some(dataset) = &dataset {
            inputs::check_env(dataset.as_ref(), entry, self.frame_skip)?;
        }
        let recorded = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned();
        let settings = recorded.as_ref().map_or_else(Map::new, |recorded| recorded.settings.clone());
        let config = self.env.config_like(settings, self.image_size.0)?;
        let rules = tier_rules(entry.id, &config.settings, tier).map_err(usage)?;
        if tier == Tier::Moderate && rules == TierRules::default() {
            output.note(format!(
                "note: {} has no moderate rules of its own: success is the environment's test, starts may move, and goals may \
                 be near",
                entry.id
            ));
        }
        note_rewards_only(entry, &rules.success, output);
        distractors::parse_all(&self.distractors).map_err(usage)?;
        let budget =
            self.budget.unwrap_or(if self.dataset.is_some() { BUDGET_DATASET } else { BUDGET_ONLINE });
        let factors = entry.make(&EnvConfig { image: None, ..config.clone() })?.spec().factors.clone();
        let scenario = match &dataset {
            None => self.scenario.options(entry, &factors, output)?,
            Some(_) => self.scenario.recorded_options(entry, &factors, output)?,
        };
        let options = ManifestOptions {
            tier,
            pairs: self.episodes,
            budget,
            frame_skip: self.frame_skip.or(recorded.map(|recorded| recorded.frame_skip)).unwrap_or(1),
            image: config.image,
            seed: self.seed,
            distractors: self.distractors.clone(),
            vary: scenario.variation,
            set: scenario.variation_values,
            success: rules.success,
            motion: rules.motion,
            rest: rules.rest,
        };
        let pairs = match (&mut dataset, &self.dataset) {
            (Some(dataset), Some(path)) => {
                let mut recorded = recorded_pairs(dataset, path)?;
                recorded.goal_offset = self.goal_offset;
                recorded.held_out = self.held_out;
                recorded.chosen.clone_from(&self.pairs);
                Some(recorded)
            }
            _ => None,
        };
        let mut manifest = make_manifest(entry, &config, &options, pairs)?;
        if let Some(path) = &self.stream {
            read_stream(path)?.lay_over(&mut manifest, entry)?;
        }
        if self.overwrite || !holds_manifest(&self.out, &manifest).map_err(usage)? {
            create_parent(&self.out)?;
            write_manifest(&self.out, &manifest)?;
        }
        Ok(manifest)
    }
}

/// Says so where no episode can be a success.
pub(super) fn note_rewards_only(entry: &EnvEntry, success: &SuccessRule, output: &Output) {
    if success.all.is_empty() && entry.success.is_empty() {
        output.note(format!(
            "note: {0} has rewards and no success test, and a manifest counts successes: all rates will be 0; `swm eval {0}` without \
             a manifest reports returns",
            entry.id
        ));
    }
}

/// Names that are listed; of more, the number is told.
const MAX_LISTED: usize = 6;

/// Factors that pairs set: those with one value in all pairs, and the others.
fn set(manifest: &Manifest) -> [Vec<String>; 2] {
    let mut values: BTreeMap<&str, Vec<&Json>> = BTreeMap::new();
    for (name, value) in manifest.pairs.iter().flat_map(|pair| &pair.set) {
        values.entry(name).or_default().push(value);
    }
    let (same, other): (Vec<_>, Vec<_>) = values.into_iter().partition(|(_, values)| {
        values.len() == manifest.pairs.len() && values.iter().all(|value| *value == values[0])
    });
    let same = same.into_iter().map(|(name, values)| format!("{name}={}", values[0]));
    [same.collect(), other.into_iter().map(|(name, _)| name.to_owned()).collect()]
}

/// Factors and groups that pairs sample.
fn sampled(manifest: &Manifest) -> Vec<String> {
    let named: BTreeSet<&String> =
        manifest.pairs.iter().filter_map(|pair| pair.vary.as_ref()).flatten().collect();
    named.into_iter().cloned().collect()
}

/// A list, cut off where it is long.
fn some_of(list: &[String]) -> String {
    let shown = &list[..list.len().min(MAX_LISTED)];
    match list.len() - shown.len() {
        0 => shown.join(", "),
        more => format!("{}, and {more} more", shown.join(", ")),
    }
}

fn show(manifest: &Manifest, path: &Path, output: &Output) -> Result<(), Failure> {
    let excluded = &manifest.excluded;
    let hash = manifest.hash();
    let image = manifest.image.map(|size| format!("{}x{}", size.height, size.width));
    let json = json!({
        "manifest": path, "hash": hash, "env": manifest.env, "tier": manifest.tier, "pairs": manifest.pairs.len(),
        "budget": manifest.budget, "success": manifest.success, "source": manifest.source, "excluded": excluded,
        "solved_at_start": manifest.solved_at_start, "image": manifest.image, "phases": manifest.phases(),
        "settings": manifest.settings, "distractors": manifest.distractors,
    });
    let mut rows = vec![
        ["environment", &manifest.env].map(str::to_owned),
        ["tier".to_owned(), manifest.tier.name().to_owned()],
        ["pairs".to_owned(), manifest.pairs.len().to_string()],
        ["success at reset".to_owned(), manifest.solved_at_start.to_string()],
        ["left out".to_owned(), excluded.describe()],
        ["source".to_owned(), manifest.source.describe()],
        ["images".to_owned(), image.unwrap_or_else(|| "none (--image-size makes some)".to_owned())],
        ["actions allowed".to_owned(), manifest.budget.to_string()],
        ["success".to_owned(), manifest.success.describe()],
    ];
    if manifest.phases() > 1 {
        rows.push(["phases of the stream".to_owned(), manifest.phases().to_string()]);
    }
    let settings: Vec<String> =
        manifest.settings.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let [same, other] = set(manifest);
    let lists =
        [("settings", settings), ("set", same), ("set per pair", other), ("sampled", sampled(manifest))];
    for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
        rows.push([name.to_owned(), some_of(&list)]);
    }
    if !manifest.distractors.is_empty() {
        rows.push(["distractors".to_owned(), manifest.distractors.join(" ")]);
    }
    rows.push(["hash".to_owned(), hash]);
    let rows: Vec<Vec<String>> = rows.into_iter().map(Vec::from).collect();
    output.result(&json, || format!("{}{}\n", table(&["manifest", ""], &rows), path.display()))
}
