//! Episodes of a policy are recorded to a dataset.

mod sink;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::env::{GOAL_IMAGE, PIXELS};
use swm_core::error::BoxError;
use swm_core::settings::Settings as _;
use swm_core::{
    Cancel, EnvConfig, EpisodeSink, ImageSize, Metadata, Registry, ResetOptions, Rollout, World, WorldError,
    WorldOptions,
};
use swm_data::{DataError, WriteMode, WriteOptions};
use swm_files::WriterLock;

use super::{
    Ask, Assignment, Fix, MAX_STEPS, Message, NUM_ENVS, Needs, Report, Request, Scenario, Shard, Stage,
    TaskError, create_parent, envs_at_most, make_policy, must_be_given, policy_args, policy_files, wrong,
};
use crate::memory::{episodes_note, machine_bytes};
use crate::threads::{self, within};
pub use sink::Count;
use sink::{Continued, Sink};

/// Size of recorded images (the reference's).
const IMAGE: ImageSize = ImageSize { height: 64, width: 64 };

/// A divided recording in a format of a file per image has at most so many.
const MAX_IMAGE_FILES: u64 = 1_000_000;

swm_core::settings! {
    /// Record episodes of a policy to a dataset.
    pub struct Record {
        /// The environment's id.
        env: String = String::new() => "must be given",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = "random".to_owned() => "random",
        /// Episodes to record. With the mode `append`, this many more.
        episodes: Option<u64> = None => "must be given, or total",
        /// Record until the dataset holds this many episodes.
        total: Option<u64> = None => "must be given, or episodes",
        /// Record the I-th of N parts of the episodes: I/N.
        ///
        /// The parts, merged in order, equal one recording byte for byte. An existing part is continued with the mode `append`.
        shard: Option<Shard> = None => "all of them",
        /// Seed of the run; episode i depends only on the seed and i.
        seed: u64 = 0,
        /// Image size, or none.
        image_size: Option<ImageSize> = Some(IMAGE) => "64x64",
        /// Record no images, and the simulator state every so many steps: loaders then render images of any size and with any colors.
        replayable: Option<u32> = None => "images",
        /// Steps after which an episode ends.
        max_steps: u64 = MAX_STEPS => "100",
        /// Environments stepped in parallel; results do not depend on it.
        num_envs: usize = NUM_ENVS => "8",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// How often each action is applied per step.
        frame_skip: u32 = 1,
        /// Factors to sample per episode: names, groups, `*.color`, `default`, `all` or `none`; `+NAME` adds to the default ones.
        vary: Option<Vec<String>> = None => "the default factors",
        /// Factors to set, by name: numbers, or names of colors and choices.
        set: Map<String, Json> = Map::new() => "none",
        /// Columns to leave out, such as `goal` (an image that is the same at every step of an episode).
        without: Vec<String> = Vec::new() => "none",
        /// The file or folder to write.
        out: PathBuf = PathBuf::new() => "must be given",
        /// The format.
        format: Option<String> = None => "by the extension of out",
        /// Quality of images, 1 to 100, in lossy formats.
        quality: Option<u8> = None => "95 in folder, 85 in video and lerobot",
        /// If the file exists: `append`, `overwrite` or `error`.
        mode: WriteMode = WriteMode::Error => "error",
        /// With the mode `append`: allow episodes of another policy, seed or shard in a part, or in a dataset up to a total.
        mix: bool = false,
    }
}

/// What was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Recorded {
    /// Episodes that were recorded.
    pub episodes: u64,
    /// Episodes that the dataset holds.
    pub total_episodes: u64,
    /// Rows that were recorded.
    pub rows: u64,
    /// Successes among the judged episodes, in %; `None`: none was judged.
    pub success_rate: Option<f64>,
}

impl Request for Record {
    const NAME: &'static str = "record";
    type Outcome = Recorded;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("env", self.env.is_empty())])?;
        registry.env(&self.env)?;
        threads::check(self.threads)?;
        if self.replayable.is_some() && ![None, Some(IMAGE)].contains(&self.image_size) {
            let size = serde_json::to_value(self.image_size).unwrap_or_default();
            let text = "a replayable recording has no images: they are rendered when it is read";
            let fix = Fix::Any(vec![Fix::Leave("image_size"), Fix::Leave("replayable")]);
            return Err(Message::about("image_size", size, text).fix(fix).into());
        }
        self.check_target(registry)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Recorded, TaskError> {
        self.check(registry)?;
        let (mut world, options) = self.prepare(registry, report)?;
        self.write(registry, report, |episodes, cancel, sink, recorder| {
            let rollout = Rollout::new(episodes).seed(self.seed).options(options).cancel(cancel);
            Ok(within(self.threads, || world.record_dataset_with(&rollout, sink, recorder))??)
        })
    }
}

impl Record {
    /// The world with its policy, and how its episodes begin.
    ///
    /// # Errors
    ///
    /// The environment or the policy cannot be made, or a factor cannot be as it is asked for.
    pub fn prepare(
        &self,
        registry: &Registry,
        report: &mut dyn Report,
    ) -> Result<(World, ResetOptions), TaskError> {
        let own = self.shard.map_or(0..self.wanted(), |shard| shard.of(self.wanted()));
        let image = self.image_size.filter(|_| self.replayable.is_none());
        let env = EnvConfig { image, settings: self.env_option.clone() };
        // A replayable recording holds no images anyway: what is left out of others may be named.
        let is_rendered_later =
            |name: &String| self.replayable.is_some() && [PIXELS, GOAL_IMAGE].contains(&name.as_str());
        let options = WorldOptions::new(envs_at_most(self.num_envs, own.end - own.start))
            .env(env)
            .max_episode_steps(self.max_steps)
            .frame_skip(self.frame_skip)
            .threads(self.threads)
            .unrecorded(self.without.iter().filter(|name| !is_rendered_later(name)).cloned())
            .checkpoints(self.replayable);
        let mut world = World::new(registry.env(&self.env)?, options).map_err(of_option)?;
        world.set_policy(make_policy(
            registry,
            &policy_args(registry, &self.policy)?,
            &world,
            Ask::Here,
            report,
        )?)?;
        let row_bytes = world.infos().schema().row_bytes() as u64;
        if let Some(much) =
            episodes_note(world.options().num_envs, self.max_steps, row_bytes, machine_bytes())
        {
            report.note(&much);
        }
        let scenario = Scenario { vary: self.vary.as_deref(), set: &self.set };
        let options = scenario.options(world.entry(), &world.spec().factors, report)?;
        self.check_absent(registry)?;
        Ok((world, options))
    }

    /// What a job needs to know before it is submitted; environment and policy are made.
    ///
    /// # Errors
    ///
    /// As of `check`; the environment or the policy cannot be made.
    pub fn needs(&self, registry: &Registry, report: &mut dyn Report) -> Result<Needs, TaskError> {
        self.check(registry)?;
        self.prepare(registry, report)?;
        let episodes = self.wanted();
        let steps = episodes.saturating_mul(self.max_steps);
        if let (Some("folder"), true) = (self.format.as_deref(), steps > MAX_IMAGE_FILES) {
            let text = format!("up to {steps} image files are too many for a shared file system");
            return Err(Message::about("format", "folder", text).fix(Fix::Leave("format")).into());
        }
        let entry = registry.env(&self.env)?;
        Ok(Needs { episodes, inputs: policy_files(registry, entry, &self.policy)? })
    }

    /// Episodes that are asked for.
    pub fn wanted(&self) -> u64 {
        self.episodes.or(self.total).unwrap_or(0)
    }

    /// Writes what `record` records: episodes of this range, before a sink and a recorder, until cancelled. Callers that have a world
    /// of their own, or actions from elsewhere, record by this; the settings of the world are then that world's.
    ///
    /// # Errors
    ///
    /// What the dataset is refuses the episodes, or `record` fails.
    pub fn write(
        &self,
        registry: &Registry,
        report: &mut dyn Report,
        record: impl FnOnce(Range<u64>, Cancel, &mut dyn EpisodeSink, &mut Count) -> Result<(), BoxError>,
    ) -> Result<Recorded, TaskError> {
        self.check_target(registry)?;
        self.check_absent(registry)?;
        let last_run = self.last_run(registry);
        create_parent(&self.out)?;
        let how = WriteOptions::default().mode(self.mode).quality(self.quality);
        let mut writer = swm_data::create_in(registry, &self.out, &how, self.format.as_deref())?;
        let held = writer.num_episodes();
        let (offset, episodes) = self.range(held)?;
        let part = self.shard.and_then(|shard| shard.part(self.wanted()));
        let run = last_run.filter(|_| held > 0 && !self.mix);
        let must_continue = self.shard.is_some()
            || self.total.is_some()
            || run.as_ref().is_some_and(|run| run.part.is_some());
        let total = episodes.end - episodes.start;
        let stage = Stage { name: Self::NAME, role: None, unit: "episodes", total };
        let progress = report.begin(&stage)?;
        progress.before(held);
        let continued = Continued { run, must_continue, part, offset };
        let mut sink = Sink::new(writer.as_mut(), &self.out, continued, progress);
        let mut count = Count::default();
        let recorded = record(episodes.clone(), report.cancel(), &mut sink, &mut count);
        let (refused, note) = sink.into_messages();
        if let Some(note) = note {
            report.note(&note);
        }
        if let Some(refused) = refused {
            return Err(refused.into());
        }
        recorded?;
        Ok(Recorded {
            episodes: total,
            total_episodes: episodes.end - offset,
            rows: count.rows(),
            success_rate: count.success_rate(),
        })
    }

    /// Refuses what cannot be written, before anything is.
    fn check_target(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[
            ("out", self.out.as_os_str().is_empty()),
            ("episodes", self.episodes.is_none() && self.total.is_none()),
        ])?;
        for (name, asked) in [("episodes", self.episodes), ("total", self.total)] {
            if asked == Some(0) {
                return Err(Message::about(name, 0, "no episode is recorded; use 1 or more").into());
            }
        }
        if let (Some(_), Some(total)) = (self.episodes, self.total) {
            let text = "counts the episodes that are there, and episodes only the new ones";
            let fix = Fix::Any(vec![Fix::Leave("total"), Fix::Leave("episodes")]);
            return Err(Message::about("total", total, text).fix(fix).into());
        }
        if let Some(quality) = self.quality.filter(|quality| !(1..=100).contains(quality)) {
            return Err(Message::about("quality", quality, "use 1 to 100").into());
        }
        if let Some(format) = &self.format {
            swm_data::format::by_name(registry, format)?;
        }
        Ok(())
    }

    /// Refuses to write a file that is there, where nothing of it may change. What is asked for is checked first: an answer to this
    /// would only bring the next refusal.
    fn check_absent(&self, registry: &Registry) -> Result<(), TaskError> {
        if self.mode != WriteMode::Error || !self.out.exists() {
            return Ok(());
        }
        // Neither of the ways on is one for a file that somebody writes.
        match WriterLock::holder_here(&self.out) {
            Some(holder) => Err(DataError::Busy { path: self.out.clone(), holder }.into()),
            None => Err(self.exists(registry).into()),
        }
    }

    /// How to go on with a file that is there.
    fn exists(&self, registry: &Registry) -> Message {
        let out = self.out.display();
        let held = match swm_data::open_in(registry, &self.out) {
            Ok(dataset) => dataset.num_episodes() as u64,
            Err(error) => {
                let text = format!("{out} exists, and no episode can be added to it ({error})");
                return Message::new(text).fix(Fix::Change("out"));
            }
        };
        let wanted = self.wanted();
        let append = Assignment::of("mode", "append");
        let more = |to: String| Fix::SetAll { settings: vec![append.clone()], instead_of: None, to };
        let up_to = |total: u64, to: String| {
            let settings = vec![append.clone(), Assignment::of("total", total)];
            Fix::SetAll { settings, instead_of: self.episodes.map(|_| "episodes"), to }
        };
        let mut fixes = match (self.shard, self.episodes) {
            (None, Some(new)) if held >= wanted => {
                let next = "for the next ones of the same recording".to_owned();
                vec![more(format!("to record {new} more")), up_to(held.saturating_add(new), next)]
            }
            (None, Some(new)) => {
                vec![up_to(new, format!("to complete it to {new}")), more(format!("to record {new} more"))]
            }
            (None, None) if held >= wanted => {
                vec![up_to(held.saturating_add(wanted), format!("to record {wanted} more"))]
            }
            _ => vec![more("to complete it".to_owned())],
        };
        fixes.push(Fix::Set { setting: Assignment::of("mode", "overwrite"), to: "to replace it" });
        let plural = if held == 1 { "" } else { "s" };
        Message::new(format!("{out} exists and holds {held} episode{plural}")).fix(Fix::Any(fixes))
    }

    /// The last run of the dataset that is appended to.
    fn last_run(&self, registry: &Registry) -> Option<Metadata> {
        let is_continued = self.mode == WriteMode::Append && self.out.exists();
        let existing = is_continued.then(|| swm_data::open_in(registry, &self.out).ok()).flatten()?;
        Some(existing.info().runs.last()?.1.clone())
    }

    /// Episodes of other parts before those of this one, and the episodes to record where the dataset holds some.
    fn range(&self, held: u64) -> Result<(u64, Range<u64>), TaskError> {
        if let Some(shard) = self.shard {
            let part = shard.of(self.wanted());
            let first = part.start + held;
            return Ok((part.start, first..part.end.max(first)));
        }
        let last = match self.episodes {
            Some(more) => held.checked_add(more).ok_or_else(|| {
                let text = format!("so many more than {held} are too many to count");
                TaskError::from(Message::about("episodes", more, text))
            })?,
            None => self.wanted().max(held),
        };
        Ok((0, held..last))
    }
}

/// Options of the world by the names that the request has for them.
fn of_option(error: WorldError) -> TaskError {
    match error {
        WorldError::Option { option, reason } => {
            let name = match option {
                "unrecorded" => "without",
                "checkpoints" => "replayable",
                "max_episode_steps" => "max_steps",
                other => other,
            };
            match Record::SETTINGS.iter().any(|setting| setting.name == name) {
                true => Message { setting: Some(Assignment::name(name)), text: reason, fix: None }.into(),
                false => wrong(WorldError::Option { option, reason }),
            }
        }
        error => error.into(),
    }
}
