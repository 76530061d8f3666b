//! `swm collect`: record episodes to a dataset.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::ProgressBar;
use serde_json::json;
use swm_core::dataset::{EncodedBatch, RowEncoder};
use swm_core::error::BoxError;
use swm_core::{
    Batch, Cancel, EpisodeEnd, EpisodeSink, LiveStep, Metadata, Recorder, RecordingPart, Registry, Rollout,
    Schema, World, WorldError,
};
use swm_data::tools::parts::other_recording;
use swm_data::{DataError, DatasetWriter, WriteMode, WriteOptions};
use swm_tasks::request::Ask;

use super::args::{EnvArgs, ImageArg, Shard, WorldArgs, policy, policy_files};
use super::output::{counted, create_parent};
use super::scenario::ScenarioArgs;
use super::work::Plan;
use super::{Failure, Output, interrupt, memory, usage};

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
    #[arg(long, default_value = "random")]
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
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Image size, HEIGHTxWIDTH, or `none`.
    #[arg(long, default_value = "64x64")]
    image_size: ImageArg,
    /// Record no images, and the simulator state every N steps (16 unless given): loaders then render images of any size and with any
    /// colors.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16", conflicts_with = "image_size")]
    replayable: Option<u32>,
    /// Steps after which an episode ends.
    #[arg(long, default_value_t = 100)]
    max_steps: u64,
    #[command(flatten)]
    pub(super) world: WorldArgs,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Columns to leave out, separated by commas, such as `goal` (an image that is the same at every step of an episode).
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    without: Vec<String>,
    /// The file to write.
    #[arg(long, short)]
    out: PathBuf,
    /// The format; default: by the file extension (`swm convert --help` lists them).
    #[arg(long)]
    format: Option<String>,
    /// Quality of images, 1 to 100, in lossy formats (`folder`: default 95; `video`, `lerobot`: 85).
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Without a terminal: say every so many seconds which episode was written; 0: after every one.
    #[arg(long, default_value_t = 10, value_name = "SECONDS")]
    report_every: u64,
    /// If the file exists: `append`, `overwrite` or `error`.
    #[arg(long, default_value = "error")]
    mode: WriteMode,
    /// With --mode append: continue a part, or a dataset up to --total, with another policy, seed or shard.
    #[arg(long)]
    mix: bool,
}

impl Collect {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let mut world = self.make_world(registry, output)?;
        let (row_bytes, num_envs) = (world.infos().schema().row_bytes() as u64, world.options().num_envs);
        if let Some(much) = memory::note(num_envs, self.max_steps, row_bytes, memory::machine_bytes()) {
            output.note(much);
        }
        let options = self.scenario.options(world.entry(), &world.spec().factors, output)?;
        if let Some(format) = &self.format {
            swm_data::format::by_name(registry, format)?;
        }
        if self.mode == WriteMode::Error && self.out.exists() {
            let held = swm_data::open_in(registry, &self.out);
            return Err(usage(self.exists(held.map(|dataset| dataset.num_episodes() as u64))));
        }
        let how = WriteOptions::default().mode(self.mode).quality(self.quality);
        let existing = match self.mode {
            WriteMode::Append if self.out.exists() => swm_data::open_in(registry, &self.out).ok(),
            _ => None,
        };
        let last_run = existing.and_then(|dataset| Some(dataset.info().runs.last()?.1.clone()));
        create_parent(&self.out)?;
        let mut writer = swm_data::create_in(registry, &self.out, &how, self.format.as_deref())?;
        let held = writer.num_episodes();
        let wanted = self.wanted();
        let part = self.shard.map(|shard| shard.of(wanted));
        let offset = part.as_ref().map_or(0, |part| part.start);
        let first = offset + held;
        let last = match (self.episodes, self.total) {
            (Some(0), _) | (_, Some(0)) => return Err(usage("0 episodes asked for; use 1 or more")),
            _ if part.is_some() => part.map_or(first, |part| part.end.max(first)),
            (Some(more), _) => first
                .checked_add(more)
                .ok_or_else(|| usage(format!("{more} more episodes than {first} are too many to count")))?,
            (None, total) => total.unwrap_or(first).max(first),
        };
        let part = self.shard.and_then(|shard| shard.part(wanted));
        let is_continued = held > 0 && !self.mix;
        let continues = last_run.filter(|_| is_continued);
        let must_continue = self.shard.is_some()
            || self.total.is_some()
            || continues.as_ref().is_some_and(|run| run.part.is_some());
        let committed = Arc::new(AtomicU64::new(held));
        let cancel = self.watch(&committed, last - offset);
        let rollout = Rollout::new(first..last).seed(self.seed).options(options).cancel(cancel);
        let started = Instant::now();
        let bar = output.bar_alone(last - first, "episodes");
        let mut sink = Committed {
            writer: writer.as_mut(),
            bar: bar.clone(),
            output,
            path: &self.out,
            committed: &committed,
            offset,
            part,
            continues,
            must_continue,
            refused: None,
            reported: started,
            report_every: Duration::from_secs(self.report_every),
        };
        let mut count = Count::default();
        let recorded = world.record_dataset_with(&rollout, &mut sink, &mut count);
        bar.finish_and_clear();
        if let Some(refused) = sink.refused {
            return Err(usage(format!("{refused}, or append all the same with --mix")));
        }
        recorded?;
        let seconds = started.elapsed().as_secs_f64();
        let result = json!({
            "out": self.out,
            "episodes": last - first,
            "total_episodes": last - offset,
            "rows": count.rows,
            "success_rate": count.success_rate(),
            "frames_per_second": count.rows as f64 / seconds,
            "wall_time_s": seconds,
        });
        output.result(&result, || {
            let success =
                count.success_rate().map(|rate| format!(", {rate:.1} % successful")).unwrap_or_default();
            format!(
                "wrote {} ({}{success}) to {} in {seconds:.1} s; it holds {}",
                counted(last - first, "episode"),
                counted(count.rows, "row"),
                self.out.display(),
                last - offset,
            )
        })
    }
}

impl Collect {
    /// Episodes that are asked for.
    fn wanted(&self) -> u64 {
        self.episodes.or(self.total).unwrap_or(0)
    }

    /// How to go on with a file that is there, and holds so many episodes, or is no dataset.
    fn exists(&self, held: Result<u64, DataError>) -> String {
        let out = self.out.display();
        let held = match held {
            Ok(held) => held,
            Err(error) => {
                return format!(
                    "{out} exists, and no episode can be added to it; give another --out ({error})"
                );
            }
        };
        let wanted = self.wanted();
        let rest = match (self.shard, self.episodes) {
            (None, Some(more)) if held >= wanted => format!(
                "to record {more} more, add `--mode append`, or, for the next ones of the same recording, `--mode append --total {}` in \
                 place of --episodes",
                held.saturating_add(more)
            ),
            (None, Some(more)) => format!(
                "to complete it to {more}, add `--mode append --total {more}` in place of --episodes; to record {more} more, `--mode \
                 append`"
            ),
            (None, None) if held >= wanted => {
                format!(
                    "--total {wanted} is reached; for more, add `--mode append` and give a greater --total"
                )
            }
            _ => "to complete it, add `--mode append`".to_owned(),
        };
        format!(
            "{out} exists and holds {}: {rest}; to replace it, `--mode overwrite`",
            counted(held, "episode")
        )
    }

    /// The world with its policy.
    fn make_world(&self, registry: &Registry, output: &Output) -> Result<World, Failure> {
        let config = self.env.config(self.image_size.0.filter(|_| self.replayable.is_none()))?;
        let asked = self.wanted();
        let own = self.shard.map_or(0..asked, |shard| shard.of(asked));
        let world = self.world.at_most(own.end - own.start).options(config, self.max_steps);
        let world = world.unrecorded(&self.without).checkpoints(self.replayable);
        let mut world = World::new(self.env.entry(registry)?, world).map_err(|error| match error {
            WorldError::Option { option: "unrecorded", reason } => usage(format!("--without: {reason}")),
            WorldError::Option { option: "checkpoints", reason } => usage(format!("--replayable: {reason}")),
            error => error.into(),
        })?;
        world.set_policy(policy(registry, &self.policy, &world, Ask::Here, output)?);
        Ok(world)
    }

    /// What a job needs to know before it is submitted, and how many steps it records at most.
    pub(super) fn plan(&self, registry: &Registry, output: &Output) -> Result<(Plan, u64), Failure> {
        let world = self.make_world(registry, output)?;
        self.scenario.options(world.entry(), &world.spec().factors, output)?;
        let episodes = self.wanted();
        if episodes == 0 {
            return Err(usage("0 episodes asked for; use 1 or more"));
        }
        if let Some(format) = &self.format {
            swm_data::format::by_name(registry, format)?;
        }
        let inputs = policy_files(registry, self.env.entry(registry)?, &self.policy)?;
        Ok((Plan { episodes, inputs }, episodes.saturating_mul(self.max_steps)))
    }

    /// What ends the recording when the command is interrupted.
    fn watch(&self, committed: &Arc<AtomicU64>, total: u64) -> Cancel {
        let (out, committed) = (self.out.display().to_string(), Arc::clone(committed));
        let rest = match (self.shard, self.total) {
            (None, None) => {
                format!("{} with --mode append --total {total} in place of --episodes", interrupt::REPEAT)
            }
            _ => format!("{} with --mode append", interrupt::REPEAT),
        };
        let safe = move || match committed.load(Ordering::Relaxed) {
            0 => "no episode was recorded".to_owned(),
            count => format!("{count} episodes are safe in {out}"),
        };
        interrupt::watch_resumable(safe, rest)
    }
}

/// Counts rows and successes.
#[derive(Default)]
struct Count {
    rows: u64,
    judged: u64,
    successes: u64,
}

impl Count {
    fn success_rate(&self) -> Option<f64> {
        (self.judged > 0).then(|| 100.0 * self.successes as f64 / self.judged as f64)
    }
}

impl Recorder for Count {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.rows += 1;
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.judged += u64::from(end.success.is_some());
        self.successes += u64::from(end.success == Some(true));
        Ok(())
    }
}

/// Reports committed episodes: on the progress bar, or by a line now and then where there is none.
struct Committed<'a> {
    writer: &'a mut dyn DatasetWriter,
    bar: ProgressBar,
    output: &'a Output,
    path: &'a std::path::Path,
    /// Episodes that the file holds.
    committed: &'a AtomicU64,
    /// Episodes of other parts, before this one's.
    offset: u64,
    /// Which part of a divided recording this is.
    part: Option<RecordingPart>,
    /// The run that this one follows in the file.
    continues: Option<Metadata>,
    /// Whether this one must be of the same recording; else a note says what differs.
    must_continue: bool,
    /// Why it does not.
    refused: Option<String>,
    /// When the last line was written, where there is no bar.
    reported: Instant,
    report_every: Duration,
}

impl EpisodeSink for Committed<'_> {
    fn begin(&mut self, schema: &Arc<Schema>, metadata: &Metadata) -> Result<u64, BoxError> {
        let metadata = Metadata { part: self.part, ..metadata.clone() };
        let path = self.path.display();
        let differs = self.continues.as_ref().and_then(|run| other_recording(run, &metadata));
        if self.must_continue
            && let Some(reason) = differs
        {
            let refusal = format!("{path}: {reason}");
            self.refused = Some(refusal.clone());
            return Err(refusal.into());
        }
        let held = self.writer.begin(schema, &metadata)?;
        // The format may refuse it, too: then nothing is appended.
        if let Some(reason) = differs {
            self.output.note(format_args!("note: this recording is appended to {path}, though {reason}"));
        }
        Ok(self.offset + held)
    }

    fn holds(&self, column: &str) -> bool {
        self.writer.holds(column)
    }

    fn write_episode(&mut self, rows: &Batch) -> Result<(), BoxError> {
        self.writer.write_episode(rows)?;
        self.report(rows.rows());
        Ok(())
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        self.writer.row_encoder(column)
    }

    fn write_encoded_episode(&mut self, rows: &EncodedBatch) -> Result<(), BoxError> {
        self.writer.write_encoded_episode(rows)?;
        self.report(rows.rows());
        Ok(())
    }

    fn finish(&mut self) -> Result<(), BoxError> {
        self.writer.finish()
    }
}

impl Committed<'_> {
    /// Tells of an episode that was committed.
    fn report(&mut self, rows: usize) {
        self.bar.inc(1);
        let committed = self.committed.fetch_add(1, Ordering::Relaxed);
        if !self.output.shows_bars() && self.reported.elapsed() >= self.report_every {
            self.reported = Instant::now();
            self.output.note(format_args!(
                "episode {} written to {} ({})",
                self.offset + committed,
                self.path.display(),
                counted(rows, "row")
            ));
        }
    }
}
