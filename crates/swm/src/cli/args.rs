//! Arguments that several commands share: the environment, the policy, the world.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Map, Value as Json, json};
use swm_core::{
    EnvConfig, EnvEntry, ImageSize, Policy, PolicyArgs, RecordingPart, Registry, World, WorldOptions,
};
use swm_data::tools::parts;

use super::output::counted;
use super::threads::ThreadsArg;
use super::training_note::{self, Ask};
use super::{Failure, Output, usage};
use crate::evaluation::RunOptions;
use crate::text_file::{json_error, read_text, toml_error};

/// The environment and how it is made.
#[derive(Args, Clone)]
pub(super) struct EnvArgs {
    /// The environment's id; `swm envs` lists them.
    pub env: String,
    /// A setting of the environment, `NAME=VALUE`; may be repeated. `swm envs ENV` lists them.
    #[arg(long = "env-option", value_name = "NAME=VALUE")]
    env_options: Vec<String>,
}

impl EnvArgs {
    pub(super) fn entry(&self, registry: &Registry) -> Result<&'static EnvEntry, Failure> {
        registry.env(&self.env).map_err(|unknown| match Path::new(&self.env).exists() {
            true => usage(format!(
                "{} is a file or folder, and the id of an environment belongs in its place, such as swm/PushT-v1; options name files, \
                 such as --dataset and --manifest",
                self.env
            )),
            false => unknown.into(),
        })
    }

    pub(super) fn config(&self, image: Option<ImageSize>) -> Result<EnvConfig, Failure> {
        self.config_like(Map::new(), image)
    }

    /// As [`EnvArgs::config`], on top of given settings: those of a dataset.
    pub(super) fn config_like(
        &self,
        mut settings: Map<String, Json>,
        image: Option<ImageSize>,
    ) -> Result<EnvConfig, Failure> {
        for option in &self.env_options {
            let (name, value) = assignment(option, "--env-option")?;
            settings.insert(name.to_owned(), json_value(value));
        }
        Ok(EnvConfig { image, settings })
    }
}

/// As [`EnvArgs`], for a command that can take the environment from a manifest.
#[derive(Args, Clone)]
pub(super) struct OptionalEnvArgs {
    /// The environment's id; `swm envs` lists them.
    env: Option<String>,
    /// A setting of the environment, `NAME=VALUE`; may be repeated. `swm envs ENV` lists them.
    #[arg(long = "env-option", value_name = "NAME=VALUE")]
    env_options: Vec<String>,
}

impl OptionalEnvArgs {
    /// The environment that was named.
    pub(super) fn take(&mut self) -> Result<EnvArgs, Failure> {
        let env = self.env.take().ok_or_else(|| usage("name an environment, or give --manifest"))?;
        Ok(EnvArgs { env, env_options: std::mem::take(&mut self.env_options) })
    }
}

/// More environments than anybody needs.
const MANY_ENVS: usize = 1 << 15;

/// How many environments run at once.
#[derive(Args, Clone)]
pub(super) struct WorldArgs {
    /// Environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = 8, value_name = "K")]
    pub num_envs: usize,
    #[command(flatten)]
    pub threads: ThreadsArg,
    /// How often each action is applied per step. Default: 1, or as in the dataset that is named.
    #[arg(long, value_name = "F")]
    pub frame_skip: Option<u32>,
}

impl WorldArgs {
    /// How a run on a manifest is spread.
    pub(super) fn run_options(&self) -> RunOptions {
        RunOptions { num_envs: self.num_envs, threads: self.threads.count(), ..RunOptions::default() }
    }

    /// The same with no more environments than episodes, for each takes time and memory to make. Numbers above
    /// [`MANY_ENVS`] stay, so that the world refuses those that it never takes, whatever the number of episodes.
    pub(super) fn at_most(&self, episodes: u64) -> Self {
        let most = usize::try_from(episodes.max(1)).unwrap_or(usize::MAX);
        let num_envs = if self.num_envs > MANY_ENVS { self.num_envs } else { self.num_envs.min(most) };
        Self { num_envs, ..self.clone() }
    }

    pub(super) fn options(&self, env: EnvConfig, max_steps: u64) -> WorldOptions {
        let options = WorldOptions::new(self.num_envs).env(env).max_episode_steps(max_steps);
        options.frame_skip(self.frame_skip.unwrap_or(1)).threads(self.threads.count())
    }
}

/// An image size: `64x64`, `96`, or `none`.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageArg(pub Option<ImageSize>);

impl std::str::FromStr for ImageArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self(None));
        }
        let (height, width) = text.split_once('x').unwrap_or((text, text));
        let side = |side: &str| {
            side.parse::<usize>().map_err(|_| {
                "write HEIGHTxWIDTH, such as 64x64, or `none` where images are optional".to_owned()
            })
        };
        ImageSize::new(side(height)?, side(width)?).map(|size| Self(Some(size)))
    }
}

/// One of several equal parts: `3/16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// The part of `0..total` that it is.
    pub(super) fn of(self, total: u64) -> std::ops::Range<u64> {
        parts::range(self.index, self.count, total)
    }

    /// Its number, counted from 1, and the number of parts.
    pub(super) fn numbers(self) -> (u64, u64) {
        (self.index, self.count)
    }

    /// The record of the part of a recording of `total` episodes. The only part is the whole, and has none.
    pub(super) fn part(self, total: u64) -> Option<RecordingPart> {
        let range = self.of(total);
        let part =
            RecordingPart { shard: self.index, of: self.count, first: range.start, end: range.end, total };
        (self.count > 1).then_some(part)
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if (1..=count).contains(&index) => Ok(Self { index, count }),
            _ => Err("write I/N with I of 1..=N, such as 3/16".to_owned()),
        }
    }
}

/// Which part of an evaluation is run, or that the parts are joined.
#[derive(Args, Clone)]
pub(super) struct PartArgs {
    /// With --out: run the I-th of N parts of the episodes of all policies or changes. When all parts are done, --join in place
    /// of it makes the result, which equals the undivided one but for the wall time.
    #[arg(long, value_name = "I/N", requires = "out", conflicts_with_all = ["again", "join"])]
    pub shard: Option<Shard>,
    /// With --out: join the parts that --shard wrote there.
    #[arg(long, requires = "out", conflicts_with = "again")]
    pub join: bool,
}

impl PartArgs {
    /// Says that a part is done.
    pub(super) fn done(
        &self,
        dir: &Path,
        shard: Shard,
        episodes: std::ops::Range<u64>,
        output: &Output,
    ) -> Result<(), Failure> {
        let ((index, count), episodes) = (shard.numbers(), episodes.end - episodes.start);
        let result = json!({ "out": dir, "shard": index, "of": count, "episodes": episodes });
        output.result(&result, || {
            format!(
                "part {index}/{count} is done ({}); when all parts are, --join in place of --shard joins them",
                counted(episodes, "episode")
            )
        })
    }
}

/// The policy of `--policy NAME:ARGS` for a world; notes tell of settings with which it can hardly search, and of those that its model was
/// trained with and how `ask` says that they are asked for.
pub(super) fn policy(
    registry: &Registry,
    text: &str,
    world: &World,
    ask: Ask,
    output: &Output,
) -> Result<Box<dyn Policy>, Failure> {
    let args = policy_args(text)?;
    let policy = registry.policy_from(&args, world)?;
    note_elites(registry, world.entry(), &args, output);
    training_note::of_policy(registry, &args, &world.into(), ask, output);
    Ok(policy)
}

/// Tells of a search that keeps most of its samples as elites. It stays where it began, which looks like a model or a task
/// that is too hard.
pub(super) fn note_elites(registry: &Registry, env: &EnvEntry, args: &PolicyArgs, output: &Output) {
    let Ok(entry) = registry.policy_entry(env, &args.name) else { return };
    let default =
        |name: &str| entry.settings.iter().find(|setting| setting.name == name)?.default.parse().ok();
    let value = |name: &str| args.named.get(name).map_or_else(|| default(name), Json::as_u64);
    // Half of few samples are elites by default.
    let is_fitted = |samples, elites| !args.named.contains_key("elites") && samples < elites;
    if let (Some(samples), Some(elites)) = (value("samples"), value("elites"))
        && !is_fitted(samples, elites)
        && 2 * elites > samples
    {
        let fewer = (samples / 10).max(2);
        output.note(format!(
            "note: {} keeps {elites} of {samples} samples as elites, so that the search hardly improves; a tenth is usual: \
             elites={fewer}",
            args.name
        ));
    }
}

/// The files that a policy's text names: its settings and its models.
pub(super) fn policy_files(registry: &Registry, env: &EnvEntry, text: &str) -> Result<Vec<PathBuf>, Failure> {
    let args = policy_args(text)?;
    let mut files = registry.policy_entry(env, &args.name)?.model_files(&args)?;
    files.extend(text.split_once(":@").map(|(_, rest)| rest.split(',').next().unwrap_or_default().into()));
    Ok(files)
}

/// The image size that the model behind a policy was trained on, for worlds that no image size is asked for.
pub(super) fn model_image(registry: &Registry, env: &EnvEntry, text: &str) -> Option<ImageSize> {
    let args = policy_args(text).ok()?;
    registry.policy_entry(env, &args.name).ok()?.image_size(&args)
}

/// A note where a policy's model, which was `trained` on images of a size, sees none, or others than those. A model that needs images
/// refuses to act without them.
pub(super) fn note_images(
    policy: &str,
    trained: Option<ImageSize>,
    shown: Option<ImageSize>,
    output: &Output,
) {
    if let Some(note) = image_note(policy, trained, shown) {
        output.note(note);
    }
}

fn image_note(policy: &str, trained: Option<ImageSize>, shown: Option<ImageSize>) -> Option<String> {
    let trained = trained.filter(|_| trained != shown)?;
    let seen =
        shown.map_or("none".to_owned(), |size| format!("images of {size}; its results may be far worse"));
    Some(format!("note: {policy} was trained on images of {trained}, and sees {seen}"))
}

/// Reads `--policy NAME:ARGS`; `NAME:@FILE` takes the arguments from a TOML or JSON file, and further `key=value`
/// after it override the file's.
pub(super) fn policy_args(text: &str) -> Result<PolicyArgs, Failure> {
    let Some((name, rest)) = text.split_once(":@") else { return Ok(named(PolicyArgs::parse(text)?)) };
    let (path, overrides) = rest.split_once(',').unwrap_or((rest, ""));
    let mut args = PolicyArgs::parse(&format!("{name}:{overrides}"))?;
    let mut named = settings_file(Path::new(path))?;
    named.extend(args.named);
    args.named = named;
    Ok(args)
}

/// What results call the reference policy no-op is the policy `constant` without values.
fn named(mut args: PolicyArgs) -> PolicyArgs {
    if ["no-op", "no_op"].contains(&args.name.as_str()) {
        args.name = "constant".to_owned();
    }
    args
}

fn settings_file(path: &Path) -> Result<Map<String, Json>, Failure> {
    let wrong = |reason: String| usage(format!("settings file {}: {reason}", path.display()));
    let text = read_text(path).map_err(|error| wrong(error.to_string()))?;
    let json = path.extension().is_some_and(|extension| extension == "json");
    if json {
        serde_json::from_str(&text).map_err(|error| wrong(json_error(&text, &error)))
    } else {
        toml::from_str(&text).map_err(|error| wrong(toml_error(&text, &error)))
    }
}

pub(super) fn assignment<'a>(text: &'a str, option: &str) -> Result<(&'a str, &'a str), Failure> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim(), value.trim())),
        _ => Err(usage(format!("{option} {text}: write NAME=VALUE"))),
    }
}

/// JSON if it is JSON, else text.
pub(super) fn json_value(text: &str) -> Json {
    serde_json::from_str(text).unwrap_or_else(|_| Json::String(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environments_are_no_more_than_episodes() {
        let made = |num_envs, episodes| {
            WorldArgs { num_envs, threads: ThreadsArg::default(), frame_skip: None }
                .at_most(episodes)
                .num_envs
        };
        assert_eq!([made(8, 100), made(10_000, 1), made(8, 3), made(0, 3), made(8, 0)], [8, 1, 3, 0, 1]);
        // Refused by the world.
        assert_eq!(made(10_000_000, 1), 10_000_000);
    }

    #[test]
    fn images_of_another_size_than_the_models_are_told() {
        let size = |side| Some(ImageSize { height: side, width: side });
        let note = image_note("mpc:lewm", size(64), size(32)).unwrap();
        assert!(note.contains("mpc:lewm was trained on images of 64x64, and sees images of 32x32"), "{note}");
        assert!(image_note("mpc:lewm", size(64), None).unwrap().ends_with("and sees none"));
        for (trained, shown) in [(size(64), size(64)), (None, size(32)), (None, None)] {
            assert_eq!(image_note("mpc:lewm", trained, shown), None);
        }
    }
}
