//! `swm manifest`: an evaluation task as a file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use clap::{Args, Subcommand, ValueEnum};
use serde_json::{Value as Json, json};
use swm_core::evaluate::{ChosenPair, Tier};
use swm_core::{Manifest, Registry};
use swm_tasks::request::{MakeManifest, Request as _};

use super::args::{EnvArgs, ImageArg};
use super::opening::DataArgs;
use super::output::table;
use super::scenario::ScenarioArgs;
use super::{Failure, Output, usage};
use crate::evaluation::read_manifest;

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<MakeManifest> = LazyLock::new(MakeManifest::default);

/// Define an evaluation task as a file: pairs of start and goal, budget, success rule.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm manifest make swm/PushT-v1 --dataset pusht.h5 --tier strict --episodes 100 --out pusht-strict.toml
  swm manifest make swm/TwoRoom-v2 --tier moderate --episodes 100 --out two-room.toml
  swm manifest make swm/PushT-v1 --dataset pusht.h5 --pairs 3:10-35,4:0-25 --tier historic --out two.toml
  swm manifest make swm/PushT-v1 --dataset pusht_expert_train.h5 --clear moderate-seed42-n100.json --image-size 224 --out clear.toml
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
    #[arg(long, value_enum, default_value_t = DEFAULT.tier.into())]
    tier: TierArg,
    /// The manifest to write.
    #[arg(long, short, value_name = "FILE")]
    out: PathBuf,
    /// Number of pairs.
    #[arg(long, default_value_t = DEFAULT.episodes)]
    episodes: usize,
    /// Seed of the pairs.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    /// Take starts and goals from this dataset. Without it, the environment samples them.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// With --dataset: these pairs and no others. 3:10-35 starts at step 10 of episode 3 and has its goal at step 35; 3:10-4:0 has
    /// it at step 0 of episode 4.
    #[arg(long, value_name = "EPISODE:START-GOAL", value_delimiter = ',', requires = "dataset")]
    #[arg(conflicts_with_all = ["episodes", "goal_offset", "held_out"])]
    pairs: Option<Vec<ChosenPair>>,
    /// With --dataset: the pairs, test of success, budget and seed of this manifest of the benchmark CLEAR-LeWM.
    #[arg(long, value_name = "FILE", requires = "dataset")]
    clear: Option<PathBuf>,
    /// With --dataset: the goal is this many steps after the start.
    #[arg(long, default_value_t = DEFAULT.goal_offset, requires = "dataset")]
    goal_offset: usize,
    /// With --dataset and --tier moderate or strict: the fraction of episodes that is held out from training. 1: all.
    #[arg(long, default_value_t = DEFAULT.held_out, requires = "dataset", value_name = "SHARE")]
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
    #[command(flatten)]
    opening: DataArgs,
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

impl From<Tier> for TierArg {
    fn from(tier: Tier) -> Self {
        match tier {
            Tier::Moderate => TierArg::Moderate,
            Tier::Strict => TierArg::Strict,
            _ => TierArg::Historic,
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

impl Make {
    /// Makes the manifest and writes it.
    fn write(&self, registry: &Registry, output: &Output) -> Result<Manifest, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        let request = MakeManifest {
            env,
            env_option,
            tier: self.tier.into(),
            out: self.out.clone(),
            episodes: self.episodes,
            seed: self.seed,
            dataset: self.dataset.clone(),
            opening: self.opening.options()?,
            pairs: self.pairs.clone(),
            clear: self.clear.clone(),
            goal_offset: self.goal_offset,
            held_out: self.held_out,
            budget: self.budget,
            frame_skip: self.frame_skip,
            image_size: self.image_size.0,
            distractor: self.distractors.clone(),
            stream: self.stream.clone(),
            vary: self.scenario.vary.clone(),
            set: self.scenario.set(output)?,
            overwrite: self.overwrite,
        };
        Ok(request.run(registry, &mut &*output)?)
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
    output.result(&json, || format!("{}{}\n", table(&["manifest", ""], rows), path.display()))
}
