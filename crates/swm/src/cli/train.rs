//! `swm train` and `swm checkpoints`: baselines learn from datasets, agents in environments or from datasets.
//!
//! Without the feature `baselines` the commands are there and say how to build it.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;

use super::looks::LookArgs;
use super::opening::ColumnArgs;
use super::threads::ThreadsArg;
use super::track::TrackArgs;
use super::{Failure, Output};

/// Train a baseline on a dataset or an agent in an environment, or resume a run.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm train --list
  swm train lewm --dataset tworoom.h5 --preset small --out runs/lewm --epochs 10
  swm train pldm --dataset tworoom.h5 --preset small --out runs/pldm --steps 2000 --set optim.lr=0.001
  swm train --resume runs/lewm
  swm train canonical --dataset small.h5 --vary visual --canonical background.color=black --canonical agent.color=red --out runs/canonical
  swm train sac --env swm/CartpoleDMControl-v0 --env-option task=swingup --preset small --steps 30000 --out runs/sac
  swm train tdmpc2 --env swm/CheetahDMControl-v0 --preset small --steps 100000 --out runs/tdmpc2
  swm train tdmpc2 --env swm/CheetahDMControl-v0 --observe pixels --preset small --steps 100000 --out runs/tdmpc2-pixels
  swm train tdmpc2 --dataset tworoom.h5 --preset small --steps 20000 --out runs/tdmpc2-data

RUN gets config.json, checkpoints, metrics.jsonl and an event file for TensorBoard. --resume continues an interrupted run from its \
last checkpoint, with the same losses as without the interruption. Evaluate it: `swm eval … --policy mpc:RUN`. \
An agent learns online, from episodes that it collects; they are committed to RUN/episodes.h5.")]
pub(super) struct Train {
    /// The baseline or agent; `--list` names them.
    #[arg(required_unless_present_any = ["list", "resume"])]
    baseline: Option<String>,
    /// List baselines and agents, and their presets.
    #[arg(long, conflicts_with_all = ["dataset", "out", "resume"])]
    list: bool,
    /// The dataset that a baseline learns from, or tdmpc2 instead of an environment; with --resume only if it has moved.
    #[arg(long, alias = "data", value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// The run's folder.
    #[arg(long, short, value_name = "RUN", required_unless_present_any = ["list", "resume"])]
    out: Option<PathBuf>,
    /// Preset, such as paper or small; `--list` names them. Default: the first of them.
    #[arg(long, conflicts_with = "resume")]
    preset: Option<String>,
    /// A setting of the baseline or agent, `NAME=VALUE`, such as `optim.lr=0.001`; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", conflicts_with = "resume")]
    set: Vec<String>,
    /// Weights of the encoder: a file (.safetensors, .pt, .ckpt), such as a DINOv2 for `dino-wm`, or a run, such as one of `gcsl`
    /// for `keypoint-wm`, or of a world model for `gc-idm`.
    #[arg(long, value_name = "FILE|RUN", conflicts_with = "resume")]
    encoder: Option<PathBuf>,
    /// Optimizer steps of the encoder that keypoint-wm trains first, in RUN/encoder, where no --encoder is given: `keypoints`, which
    /// learns to draw the images.
    #[arg(long, value_name = "STEPS", default_value_t = 1500, conflicts_with_all = ["encoder", "resume"])]
    encoder_steps: u64,
    /// Resume the run in this folder, or in --out, possibly with more epochs or steps.
    #[arg(long, value_name = "RUN", conflicts_with = "baseline")]
    #[expect(clippy::option_option, reason = "clap: not given, given alone, or with a folder")]
    resume: Option<Option<PathBuf>>,
    /// Epochs over the clips, in each phase. Default: 10.
    #[arg(long, conflicts_with = "steps")]
    epochs: Option<u64>,
    /// Optimizer steps, in each phase; of an agent, steps of the environment.
    #[arg(long)]
    steps: Option<u64>,
    /// Clips per step. Default: the preset's.
    #[arg(long, conflicts_with = "resume")]
    batch: Option<usize>,
    /// Device: cpu; in builds with the feature `cuda` also cuda, cuda:1 …
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Precision of linear layers and attention: fp32, or bf16 with fp32 weights. Default: fp32, or the run's.
    #[arg(long)]
    precision: Option<String>,
    /// Seed of weights, order and noise. Default: 42.
    #[arg(long, conflicts_with = "resume")]
    seed: Option<u64>,
    /// Fraction of episodes for training; the others are for validation.
    #[arg(long, default_value_t = SPLIT, conflicts_with = "resume")]
    split: f64,
    /// Fraction of episodes that is held out from both, for `swm manifest make --held-out` of the same share.
    #[arg(long, default_value_t = 0.0, conflicts_with = "resume", value_name = "SHARE")]
    held_out: f64,
    /// Steps between logged metrics. Default: 20.
    #[arg(long, value_name = "STEPS")]
    log_every: Option<u64>,
    /// Steps between validations and checkpoints. Default: an epoch.
    #[arg(long, value_name = "STEPS")]
    checkpoint_every: Option<u64>,
    /// Checkpoints to keep in addition to the best. Default: 3.
    #[arg(long)]
    keep: Option<usize>,
    /// Batches from which batch-norm statistics are estimated anew before each validation and checkpoint, without dropout.
    /// Default: 0, those that training gathers.
    #[arg(long, value_name = "BATCHES", conflicts_with = "resume")]
    norm_batches: Option<usize>,
    /// Measure the model every so many steps as `swm quality` does (probes, ranking of plans, open-loop error), for
    /// metrics.jsonl and TensorBoard; 0: never. Default: 0, or the run's.
    #[arg(long, value_name = "STEPS")]
    quality_every: Option<u64>,
    /// Early stopping: validations without improvement after which training stops.
    #[arg(long, value_name = "VALIDATIONS")]
    patience: Option<u64>,
    #[command(flatten)]
    pub(super) threads: ThreadsArg,
    #[command(flatten)]
    pub(super) track: TrackArgs,
    #[command(flatten)]
    online: OnlineArgs,
    #[command(flatten)]
    looks: LookArgs,
    #[command(flatten)]
    opening: ColumnArgs,
    /// A part of the dataset, such as `val`.
    #[arg(long, value_name = "NAME", help_heading = OTHERS)]
    dataset_split: Option<String>,
    /// Rows of an episode that ran into its time limit, where a file of D4RL does not mark these.
    #[arg(long, value_name = "N", help_heading = OTHERS)]
    dataset_max_steps: Option<usize>,
    /// Resize the dataset's images, by area, when they are read: HEIGHTxWIDTH. Needed where they are not square.
    #[arg(long, value_name = "SIZE", help_heading = OTHERS)]
    image_size: Option<super::args::ImageArg>,
    /// How: `stretch` them, `crop` their middle, or `pad` them with black. Needed where --image-size has another shape than theirs.
    #[arg(long, value_name = "HOW", requires = "image_size", help_heading = OTHERS)]
    fit: Option<swm_data::adapt::Fit>,
}

/// Where help lists what is about datasets of other programs.
const OTHERS: &str = "Datasets of other programs";

/// What agents learn in.
#[derive(Args)]
#[command(next_help_heading = "Learning online")]
struct OnlineArgs {
    /// The environment that an agent learns in; `swm envs` lists them.
    #[arg(long, value_name = "ID", conflicts_with_all = ["dataset", "resume"])]
    env: Option<String>,
    /// A setting of the environment, `NAME=VALUE`; may be repeated.
    #[arg(long = "env-option", value_name = "NAME=VALUE", requires = "env")]
    env_options: Vec<String>,
    /// Columns that the agent observes, with commas: vectors, and of tdmpc2 also pixels. Default: observation, state or proprio,
    /// whichever is there; of a dataset its goal, too.
    #[arg(long, value_name = "COLUMNS", value_delimiter = ',', conflicts_with = "resume")]
    observe: Vec<String>,
    /// Steps after which an episode is truncated. Default: 500.
    #[arg(long, value_name = "STEPS", requires = "env")]
    max_steps: Option<u64>,
    /// Steps between evaluations, each with a checkpoint. Default: 5000.
    #[arg(long, value_name = "STEPS")]
    eval_every: Option<u64>,
    /// Episodes of an evaluation. Default: 5.
    #[arg(long, value_name = "EPISODES")]
    eval_episodes: Option<u64>,
}

impl Train {
    /// Runs it, while trackers follow.
    pub(super) fn tracked(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let run = self.resume.clone().flatten().or_else(|| self.out.clone());
        let is_training = cfg!(feature = "baselines") && !self.list;
        self.track
            .clone()
            .around(run.as_deref().filter(|_| is_training), output, || self.run(registry, output))
    }
}

/// The default of `--split`.
const SPLIT: f64 = 0.9;

#[cfg(feature = "baselines")]
impl Train {
    /// How the dataset of a new run is opened; a run that is resumed knows it.
    fn opening(&self) -> Result<swm_data::OpenOptions, Failure> {
        let options = self.opening.options()?;
        let options = options.split(self.dataset_split.clone()).max_steps(self.dataset_max_steps);
        let options = options.image_size(self.image_size.and_then(|size| size.0)).fit(self.fit);
        let Some(&option) = options.given().first() else { return Ok(options) };
        let option = match option {
            "split" | "max_steps" => format!("dataset-{}", option.replace('_', "-")),
            option => option.replace('_', "-"),
        };
        let reason = match () {
            () if self.resume.is_some() => {
                "a run is resumed with the dataset as it was opened for it; leave it out"
            }
            () if self.dataset.is_none() => {
                "it is about a dataset, and none is named; give --dataset, or leave it out"
            }
            () => return Ok(options),
        };
        Err(super::usage(format!("--{option}: {reason}")))
    }

    /// The run's folder: --out, or that behind --resume.
    fn folder(&self) -> Result<&std::path::Path, Failure> {
        match (self.resume.as_ref().and_then(Option::as_deref), self.out.as_deref()) {
            (Some(run), Some(out)) if run != out => Err(super::usage(format!(
                "--resume {} --out {}: a run is resumed in its own folder; name it once: swm train --resume {0}",
                run.display(),
                out.display()
            ))),
            (Some(run), _) | (None, Some(run)) => Ok(run),
            (None, None) => Err(super::usage("--resume: name the run's folder: swm train --resume RUN")),
        }
    }
}

/// List the checkpoints of a training run.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm checkpoints runs/lewm\n  swm checkpoints runs/lewm --json")]
pub(super) struct Checkpoints {
    /// The run's folder.
    run: PathBuf,
}

#[cfg(not(feature = "baselines"))]
mod work {
    use swm_core::Registry;

    use super::{Checkpoints, LookArgs, Train};
    use crate::cli::{Failure, Output, usage};

    use crate::absent::BASELINES;

    fn not_built() -> Failure {
        let (feature, command) = BASELINES;
        usage(format!("this program was built without the feature `{feature}`: {command}"))
    }

    impl Train {
        pub(in crate::cli) fn run(self, _registry: &Registry, _output: &Output) -> Result<(), Failure> {
            let Self {
                baseline: _,
                list: _,
                dataset: _,
                online:
                    super::OnlineArgs {
                        env: _,
                        env_options: _,
                        observe: _,
                        max_steps: _,
                        eval_every: _,
                        eval_episodes: _,
                    },
                out: _,
                preset: _,
                set: _,
                encoder: _,
                encoder_steps: _,
                resume: _,
                epochs: _,
                steps: _,
                batch: _,
                device: _,
                precision: _,
                seed: _,
                split: _,
                held_out: _,
                log_every: _,
                checkpoint_every: _,
                keep: _,
                norm_batches: _,
                quality_every: _,
                patience: _,
                threads: _,
                track: _,
                looks: LookArgs { look: _, vary: _, vary_share: _, vary_usual: _, canonical: _ },
                opening: _,
                dataset_split: _,
                dataset_max_steps: _,
                image_size: _,
                fit: _,
            } = self;
            Err(not_built())
        }
    }

    impl Train {
        pub(in crate::cli) fn inputs(&self) -> Result<Vec<std::path::PathBuf>, Failure> {
            Err(not_built())
        }
    }

    impl Checkpoints {
        pub(in crate::cli) fn run(self, _output: &Output) -> Result<(), Failure> {
            let Self { run: _ } = self;
            Err(not_built())
        }
    }
}

#[cfg(feature = "baselines")]
#[path = "train_work.rs"]
mod work;

#[cfg(feature = "baselines")]
#[path = "train_checkpoints.rs"]
mod checkpoints;

#[cfg(feature = "baselines")]
#[path = "train_online.rs"]
mod online;
