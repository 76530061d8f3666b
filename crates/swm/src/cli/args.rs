//! Arguments that several commands share: the environment, the policy, the world.

use std::path::Path;

use clap::Args;
use serde_json::{Map, Value as Json, json};
use swm_core::{EnvConfig, EnvEntry, ImageSize, Policy, Registry, World, WorldOptions};
use swm_tasks::request::{self, Ask, NUM_ENVS};
pub(super) use swm_tasks::request::{Shard, model_image, policy_args, policy_files};

use super::output::counted;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};
use crate::evaluation::RunOptions;

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
    /// The id of the environment that was named, empty where none was, and its settings.
    pub(super) fn named(&self, registry: &Registry) -> Result<(String, Map<String, Json>), Failure> {
        let env_options = self.env_options.clone();
        let env = EnvArgs { env: self.env.clone().unwrap_or_default(), env_options };
        let id = if env.env.is_empty() { String::new() } else { env.entry(registry)?.id.to_owned() };
        Ok((id, env.config(None)?.settings))
    }

    /// The environment that was named.
    pub(super) fn take(&mut self) -> Result<EnvArgs, Failure> {
        let env = self.env.take().ok_or_else(|| usage("name an environment, or give --manifest"))?;
        Ok(EnvArgs { env, env_options: std::mem::take(&mut self.env_options) })
    }
}

/// How many environments run at once.
#[derive(Args, Clone)]
pub(super) struct WorldArgs {
    /// Environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = NUM_ENVS, value_name = "K")]
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

    pub(super) fn options(&self, env: EnvConfig, max_steps: u64) -> WorldOptions {
        let options = WorldOptions::new(self.num_envs).env(env).max_episode_steps(max_steps);
        options.frame_skip(self.frame_skip.unwrap_or(1)).threads(self.threads.count())
    }
}

/// An image size: `64x64`, `96`, or `none`.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageArg(pub Option<ImageSize>);

impl std::fmt::Display for ImageArg {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            None => f.write_str("none"),
            Some(size) => size.fmt(f),
        }
    }
}

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

/// Which part of an evaluation is run, or that the parts are joined.
#[derive(Args, Clone, Default)]
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
        dir: Option<&Path>,
        shard: Shard,
        episodes: u64,
        output: &Output,
    ) -> Result<(), Failure> {
        let (index, count) = shard.numbers();
        let result = json!({ "out": dir, "shard": index, "of": count, "episodes": episodes });
        output.result(&result, || {
            format!(
                "part {index}/{count} is done ({}); when all parts are, --join in place of --shard joins them",
                counted(episodes, "episode")
            )
        })
    }
}

/// As [`request::make_policy`].
pub(super) fn policy(
    registry: &Registry,
    text: &str,
    world: &World,
    ask: Ask,
    output: &Output,
) -> Result<Box<dyn Policy>, Failure> {
    Ok(request::make_policy(registry, text, world, ask, &mut &*output)?)
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
