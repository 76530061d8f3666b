//! `swm train`: baselines learn from datasets, agents in environments or from datasets.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{HumanDuration, ProgressBar};
use serde_json::{Value as Json, json};
use swm_core::error::BoxError;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, Figures, Message, Progress, Report, Request as _, Stage, TrainerEntry};

use super::args::{assignments, json_value};
use super::looks::LookArgs;
use super::opening::ColumnArgs;
use super::output::{key_values, table};
use super::threads::ThreadsArg;
use super::track::TrackArgs;
use super::words::{Options, Renamed};
use super::{Failure, Output, interrupt, usage};
use crate::jobs::task;
use crate::jobs::tracking::around;

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Train> = LazyLock::new(request::Train::default);
/// How long an interrupted training may take to end its step and to write a checkpoint. Slurm waits 30 s.
const SAVING: Duration = Duration::from_secs(25);
/// The same in a task whose time is limited: the script has the signal come 120 s before the end.
const SAVING_IN_TIME: Duration = Duration::from_secs(110);

/// Train a baseline on a dataset or an agent in an environment, or resume a run.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm train --list
  swm train lewm --dataset tworoom.h5 --preset small --out runs/lewm --epochs 10
  swm train pldm --dataset tworoom.h5 --preset small --out runs/pldm --steps 2000 --set optim.lr=0.001
  swm train --resume runs/lewm
  swm train --from runs/lewm --dataset more.h5 --out runs/lewm-more --set optim.lr=0.0001
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
    baseline: Option<String>,
    /// List baselines and agents, and their presets.
    #[arg(long, conflicts_with_all = ["dataset", "out", "resume"])]
    list: bool,
    /// The dataset that a baseline learns from, or tdmpc2 instead of an environment; with --resume only if it has moved.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// The run's folder.
    #[arg(long, short, value_name = "RUN")]
    out: Option<PathBuf>,
    /// Preset, such as paper or small; `--list` names them. Default: the first of the baseline or agent.
    #[arg(long, conflicts_with = "resume")]
    preset: Option<String>,
    /// A setting of the baseline or agent, `NAME=VALUE`, such as `optim.lr=0.001`; may be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE", conflicts_with = "resume")]
    set: Vec<String>,
    /// Begin with the model of this run, also of an import: its settings, the weights of its last checkpoint, how its vectors are scaled.
    #[arg(long = "from", value_name = "RUN", conflicts_with_all = ["preset", "encoder", "encoder_steps", "resume"])]
    from_run: Option<PathBuf>,
    /// Weights of the encoder: a file (.safetensors, .pt, .ckpt), such as a DINOv2 for `dino-wm`, or a run, such as one of `gcsl`
    /// for `keypoint-wm`, or of a world model for `gc-idm`.
    #[arg(long, value_name = "FILE|RUN", conflicts_with = "resume")]
    encoder: Option<PathBuf>,
    /// Optimizer steps of the encoder that keypoint-wm trains first, in RUN/encoder, where no --encoder is given: `keypoints`, which
    /// learns to draw the images.
    #[arg(long, value_name = "STEPS", default_value_t = DEFAULT.encoder_steps, conflicts_with_all = ["encoder", "resume"])]
    encoder_steps: u64,
    /// Resume the run in this folder, or in --out, possibly with more epochs or steps.
    #[arg(long, value_name = "RUN", conflicts_with = "baseline")]
    #[expect(clippy::option_option, reason = "clap: not given, given alone, or with a folder")]
    resume: Option<Option<PathBuf>>,
    /// Epochs over the clips, in each phase. Default: 10, or the run's.
    #[arg(long, conflicts_with = "steps")]
    epochs: Option<u64>,
    /// Optimizer steps, in each phase; of an agent, steps of the environment.
    #[arg(long)]
    steps: Option<u64>,
    /// Clips per step. Default: the preset's.
    #[arg(long, conflicts_with = "resume")]
    batch: Option<usize>,
    /// Device: cpu; in builds with the feature `cuda` also cuda, cuda:1 …
    #[arg(long, default_value = DEFAULT.device.as_str())]
    device: String,
    /// Precision of linear layers and attention: fp32, or bf16 with fp32 weights. Default: fp32, or the run's.
    #[arg(long)]
    precision: Option<String>,
    /// Seed of weights, order and noise. Default: 42.
    #[arg(long, conflicts_with = "resume")]
    seed: Option<u64>,
    /// Fraction of episodes for training; the others are for validation.
    #[arg(long, default_value_t = DEFAULT.split, conflicts_with = "resume")]
    split: f64,
    /// Fraction of episodes that is held out from both, for `swm manifest make --held-out` of the same share.
    #[arg(long, default_value_t = DEFAULT.held_out, conflicts_with = "resume", value_name = "SHARE")]
    held_out: f64,
    /// Steps between logged metrics. Default: 20, of an agent 500; or the run's.
    #[arg(long, value_name = "STEPS")]
    log_every: Option<u64>,
    /// Steps between validations and checkpoints. Default: an epoch, or the run's.
    #[arg(long, value_name = "STEPS")]
    checkpoint_every: Option<u64>,
    /// Checkpoints to keep in addition to the best. Default: 3, or the run's.
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
    threads: ThreadsArg,
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
    /// Steps between evaluations, each with a checkpoint. Default: 5000, or the run's.
    #[arg(long, value_name = "STEPS")]
    eval_every: Option<u64>,
    /// Episodes of an evaluation. Default: 5, or the run's.
    #[arg(long, value_name = "EPISODES")]
    eval_episodes: Option<u64>,
}

impl Train {
    /// What is asked for.
    pub(super) fn request(&self) -> Result<request::Train, Failure> {
        let (resume, out) = match (&self.resume, self.out.clone().unwrap_or_default()) {
            (None, out) => (None, out),
            (Some(Some(run)), out) => (Some(run.clone()), out),
            (Some(None), out) if out.as_os_str().is_empty() => {
                return Err(usage("--resume: name the run's folder: swm train --resume RUN"));
            }
            (Some(None), out) => (Some(out), PathBuf::new()),
        };
        let opening = self.opening.options()?;
        let opening = opening.split(self.dataset_split.clone()).max_steps(self.dataset_max_steps);
        let opening = opening.image_size(self.image_size.and_then(|size| size.0)).fit(self.fit);
        let Self { looks, online, .. } = self;
        Ok(request::Train {
            baseline: self.baseline.clone().unwrap_or_default(),
            dataset: self.dataset.clone(),
            opening,
            out,
            preset: self.preset.clone(),
            set: assignments(&self.set, "--set", json_value)?,
            from_run: self.from_run.clone(),
            encoder: self.encoder.clone(),
            encoder_steps: self.encoder_steps,
            resume,
            epochs: self.epochs,
            steps: self.steps,
            batch: self.batch,
            device: self.device.clone(),
            precision: self.precision.clone(),
            seed: self.seed,
            split: self.split,
            held_out: self.held_out,
            log_every: self.log_every,
            checkpoint_every: self.checkpoint_every,
            keep: self.keep,
            norm_batches: self.norm_batches,
            quality_every: self.quality_every,
            patience: self.patience,
            look: assignments(&looks.look, "--look", |text| json!(text))?,
            vary: looks.vary.clone(),
            vary_share: looks.vary_share,
            vary_usual: looks.vary_usual,
            canonical: looks.canonical_look()?,
            env: online.env.clone(),
            env_option: assignments(&online.env_options, "--env-option", json_value)?,
            observe: online.observe.clone(),
            max_steps: online.max_steps,
            eval_every: online.eval_every,
            eval_episodes: online.eval_episodes,
            threads: self.threads.count(),
        })
    }

    /// Whether what there is to train is only listed.
    pub(super) fn lists(&self) -> bool {
        self.list
    }

    /// Runs it, while trackers follow.
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if self.list {
            return list(registry, output);
        }
        let request = self.request()?;
        request.check(registry).map_err(|error| WORDS.failure(error))?;
        around(
            &self.track.tracking(),
            request.folder(),
            |note| output.note(note),
            || run(&request, registry, output),
        )
    }
}

/// Runs the request of a training.
pub(super) fn run(request: &request::Train, registry: &Registry, output: &Output) -> Result<(), Failure> {
    let mut watching = Watching { output, run: request.folder(), cancel: Cancel::new() };
    let trained = request.run(registry, &mut watching).map_err(|error| WORDS.failure(error))?;
    output.result(&trained, || key_values(&trained.summary))
}

/// What has no option, or one of another name.
const WORDS: Renamed = Renamed(&[("baseline", "baseline"), ("env", "--env"), ("from_run", "--from")]);

/// What there is to train.
fn list(registry: &Registry, output: &Output) -> Result<(), Failure> {
    let trainers = TrainerEntry::all(registry)?;
    let json =
        |entry: &&TrainerEntry| json!({ "name": entry.name, "about": entry.about, "presets": entry.presets });
    let all: Vec<Json> = trainers.iter().map(json).collect();
    let row =
        |entry: &&TrainerEntry| vec![entry.name.to_owned(), entry.presets.join(", "), entry.about.to_owned()];
    let rows = trainers.iter().map(row);
    output.result(&all, || table(&["baseline", "presets", "what it is"], rows))
}

/// The report of a training: its run is resumed after Ctrl-C, and figures are lines where no bar is shown.
struct Watching<'a> {
    output: &'a Output,
    /// The run, which may have an encoder trained before.
    run: &'a Path,
    cancel: Cancel,
}

impl Report for Watching<'_> {
    fn note(&mut self, note: &Message) {
        Report::note(&mut &*self.output, note);
    }

    fn info(&mut self, info: &Message) {
        self.output.note(info.in_words(&Options));
    }

    fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        let folder = stage.name.to_owned();
        let how = match Path::new(&folder) == self.run {
            true => format!("run: swm train --resume {folder}"),
            false => "run the same command".to_owned(),
        };
        let is_limited = task::time_left(Instant::now()).is_some();
        interrupt::allow(if is_limited { SAVING_IN_TIME } else { SAVING });
        let safe = move || {
            let saved = Path::new(&folder).join("checkpoints").read_dir();
            match saved.is_ok_and(|mut saved| saved.next().is_some()) {
                true => format!("the last checkpoint is safe in {folder}"),
                false => format!("{folder} has no checkpoint yet, and begins anew"),
            }
        };
        self.cancel = interrupt::watch_resumable(safe, how);
        let bar = self.output.bar_alone(stage.total, stage.unit);
        Ok(Box::new(Steps { bar, output: self.output.clone() }))
    }
}

/// The steps of a training.
struct Steps {
    bar: ProgressBar,
    output: Output,
}

impl Progress for Steps {
    fn done(&self, _success: Option<bool>) {
        self.bar.inc(1);
    }

    /// Steps come one by one, and those of a run that is resumed at once.
    fn advance(&self, units: u64) {
        self.bar.inc(units);
        if units > 1 {
            self.bar.reset_eta();
        }
    }

    fn figures(&self, figures: &Figures) {
        let Figures { line, brief, left } = figures;
        if let Some(brief) = brief {
            self.bar.set_message(brief.clone());
            if self.output.shows_bars() {
                return;
            }
        }
        let left = left.map_or(String::new(), |left| format!(", {} left", HumanDuration(left)));
        self.bar.suspend(|| self.output.note(format_args!("{line}{left}")));
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
