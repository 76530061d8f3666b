//! `swm collect`: record episodes to a dataset.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::ProgressBar;
use serde_json::json;
use swm_core::error::BoxError;
use swm_core::{Cancel, Registry};
use swm_data::WriteMode;
use swm_tasks::request::{Message, Progress, Record, Recorded, Report, Request as _, Stage};

use super::args::{EnvArgs, ImageArg, Shard, WorldArgs};
use super::output::{counted, print_to_stderr};
use super::scenario::ScenarioArgs;
use super::{Failure, Output, interrupt};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<Record> = LazyLock::new(Record::default);

/// Seconds between lines, where there is no bar.
const REPORT_EVERY: u64 = 10;

/// Record episodes of a policy to a dataset.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm collect swm/PushT-v1 --policy expert --episodes 100 --seed 1 --out pusht.h5
  swm collect swm/PushT-v1 --policy weak --episodes 50 --vary +agent.color,block.color --set background.color=black --out weak.h5
  swm collect swm/PushT-v1 --policy expert --episodes 1000 --replayable --out small.h5   (images are rendered when read)
  swm collect swm/PushT-v1 --policy expert --episodes 100 --quality 95 --out pusht.video   (videos)
  swm collect swm/PushT-v1 --policy expert --total 1000 --seed 1 --mode append --out pusht.h5   (continue up to 1000)
  swm collect swm/PushT-v1 --policy expert --episodes 1000 --shard 3/16 --out pusht.3.h5   (on one of 16 machines; then swm merge)

A committed episode survives a crash or kill.")]
pub(super) struct Collect {
    #[command(flatten)]
    env: EnvArgs,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long, default_value = DEFAULT.policy.as_str())]
    policy: String,
    /// Episodes to record. With `--mode append`, this many more.
    #[arg(long, value_name = "N", required_unless_present = "total")]
    episodes: Option<u64>,
    /// Record until the dataset holds this many episodes.
    #[arg(long, value_name = "N", conflicts_with = "episodes")]
    total: Option<u64>,
    /// Record the I-th of N parts of the episodes. The parts, merged in order, equal one recording byte for byte. An existing part
    /// is continued with `--mode append`; `swm merge` refuses missing and incomplete parts.
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Seed of the run; episode i depends only on the seed and i.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    /// Image size, HEIGHTxWIDTH, or `none`.
    #[arg(long, default_value_t = ImageArg(DEFAULT.image_size))]
    image_size: ImageArg,
    /// Record no images, and the simulator state every N steps (16 unless given): loaders then render images of any size and with any
    /// colors.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16", conflicts_with = "image_size")]
    replayable: Option<u32>,
    /// Steps after which an episode ends.
    #[arg(long, default_value_t = DEFAULT.max_steps)]
    max_steps: u64,
    #[command(flatten)]
    world: WorldArgs,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Columns to leave out, separated by commas, such as `goal` (an image that is the same at every step of an episode).
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    without: Vec<String>,
    /// The file to write.
    #[arg(long, short, required = true)]
    out: Option<PathBuf>,
    /// The format; default: by the file extension (`swm convert --help` lists them).
    #[arg(long)]
    format: Option<String>,
    /// Quality of images, 1 to 100, in lossy formats. Default: 95 in `folder`, 85 in `video` and `lerobot`.
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Without a terminal: say every so many seconds which episode was written; 0: after every one.
    #[arg(long, default_value_t = REPORT_EVERY, value_name = "SECONDS")]
    report_every: u64,
    /// If the file exists: `append`, `overwrite` or `error`.
    #[arg(long, default_value_t = DEFAULT.mode)]
    mode: WriteMode,
    /// With --mode append: allow episodes of another policy, seed or shard in a part, or in a dataset up to --total.
    #[arg(long)]
    mix: bool,
}

/// Records, and prints what was recorded. `report_every`: seconds between lines where there is no bar.
pub(super) fn run(
    request: &Record,
    report_every: Option<u64>,
    registry: &Registry,
    output: &Output,
) -> Result<(), Failure> {
    let started = Instant::now();
    let report_every = Duration::from_secs(report_every.unwrap_or(REPORT_EVERY));
    let mut shown = Shown::new(request, report_every, output);
    let recorded = request.run(registry, &mut shown);
    shown.bar.finish_and_clear();
    let Recorded { episodes, total_episodes, rows, success_rate } = recorded?;
    let seconds = started.elapsed().as_secs_f64();
    let result = json!({
        "out": request.out,
        "episodes": episodes,
        "total_episodes": total_episodes,
        "rows": rows,
        "success_rate": success_rate,
        "frames_per_second": rows as f64 / seconds,
        "wall_time_s": seconds,
    });
    output.result(&result, || {
        let success = success_rate.map(|rate| format!(", {rate:.1} % successful")).unwrap_or_default();
        format!(
            "wrote {} ({}{success}) to {} in {seconds:.1} s; it holds {total_episodes}",
            counted(episodes, "episode"),
            counted(rows, "row"),
            request.out.display(),
        )
    })
}

impl Collect {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        run(&self.request(registry, output)?, self.report_every(), registry, output)
    }

    /// Seconds between lines, where others than the default were given.
    pub(super) fn report_every(&self) -> Option<u64> {
        Some(self.report_every).filter(|&seconds| seconds != REPORT_EVERY)
    }

    /// What is asked for.
    pub(super) fn request(&self, registry: &Registry, output: &Output) -> Result<Record, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        Ok(Record {
            env,
            env_option,
            policy: self.policy.clone(),
            episodes: self.episodes,
            total: self.total,
            shard: self.shard,
            seed: self.seed,
            image_size: self.image_size.0,
            replayable: self.replayable,
            max_steps: self.max_steps,
            num_envs: self.world.num_envs,
            threads: self.world.threads.count(),
            frame_skip: self.world.frame_skip.unwrap_or(DEFAULT.frame_skip),
            vary: self.scenario.vary.clone(),
            set: self.scenario.set(output)?,
            without: self.without.clone(),
            out: self.out.clone().unwrap_or_default(),
            format: self.format.clone(),
            quality: self.quality,
            mode: self.mode,
            mix: self.mix,
        })
    }
}

/// A recording on a progress bar, or by a line now and then where there is none.
struct Shown<'a> {
    output: &'a Output,
    bar: ProgressBar,
    episodes: Arc<Episodes>,
    /// Whether an interrupted recording is continued up to a total, in place of a number of episodes.
    is_up_to_total: bool,
}

/// The episodes of a recording.
struct Episodes {
    bar: ProgressBar,
    /// Whether lines are written in place of the bar.
    has_lines: bool,
    path: PathBuf,
    /// Those that the file holds.
    committed: AtomicU64,
    /// Those that it shall hold.
    total: AtomicU64,
    /// When the last line was written.
    reported: Mutex<Instant>,
    report_every: Duration,
}

impl<'a> Shown<'a> {
    fn new(request: &Record, report_every: Duration, output: &'a Output) -> Self {
        let bar = output.bar_alone(0, "episodes");
        let episodes = Episodes {
            bar: bar.clone(),
            has_lines: output.shows_lines(),
            path: request.out.clone(),
            committed: AtomicU64::new(0),
            total: AtomicU64::new(0),
            reported: Mutex::new(Instant::now()),
            report_every,
        };
        let is_up_to_total = request.shard.is_none() && request.total.is_none();
        Self { output, bar, episodes: Arc::new(episodes), is_up_to_total }
    }
}

impl Report for Shown<'_> {
    fn note(&mut self, note: &Message) {
        let mut output = self.output;
        Report::note(&mut output, note);
    }

    fn begin(&mut self, stage: &Stage<'_>) -> Result<Box<dyn Progress>, BoxError> {
        self.bar.set_length(stage.total);
        self.bar.reset_eta();
        self.episodes.total.store(stage.total, Ordering::Relaxed);
        Ok(Box::new(Written(Arc::clone(&self.episodes))))
    }

    fn cancel(&self) -> Cancel {
        let total = self.episodes.total.load(Ordering::Relaxed);
        let rest = match self.is_up_to_total {
            true => format!(" --total {total} in place of --episodes"),
            false => String::new(),
        };
        let rest = format!("{} with --mode append{rest}", interrupt::REPEAT);
        let episodes = Arc::clone(&self.episodes);
        let safe = move || match episodes.committed.load(Ordering::Relaxed) {
            0 => "no episode was recorded".to_owned(),
            count => format!("{count} episodes are safe in {}", episodes.path.display()),
        };
        interrupt::watch_resumable(safe, rest)
    }
}

/// Counts the episodes that are written.
struct Written(Arc<Episodes>);

impl Progress for Written {
    fn before(&self, units: u64) {
        self.0.committed.fetch_add(units, Ordering::Relaxed);
        self.0.total.fetch_add(units, Ordering::Relaxed);
    }

    fn done(&self, _success: Option<bool>) {
        self.0.bar.inc(1);
        self.0.committed.fetch_add(1, Ordering::Relaxed);
    }

    fn written(&self, episode: u64, rows: usize) {
        self.done(None);
        let shown = &*self.0;
        let mut reported = shown.reported.lock().unwrap_or_else(PoisonError::into_inner);
        if shown.has_lines && reported.elapsed() >= shown.report_every {
            *reported = Instant::now();
            let (path, rows) = (shown.path.display(), counted(rows, "row"));
            print_to_stderr(&format!("episode {episode} written to {path} ({rows})\n"));
        }
    }
}
