//! Arguments that several commands share: the environment, the policy, the world.

use std::path::Path;

use clap::Args;
use serde_json::{Map, Value as Json, json};
use swm_core::{EnvConfig, EnvEntry, ImageSize, Registry};
use swm_tasks::request::NUM_ENVS;
pub(super) use swm_tasks::request::Shard;

use super::output::counted;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};

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
        Ok(EnvConfig { image, settings: assignments(&self.env_options, "--env-option", json_value)? })
    }

    /// The environment's id and settings, as requests have them.
    pub(super) fn named(&self, registry: &Registry) -> Result<(String, Map<String, Json>), Failure> {
        Ok((self.entry(registry)?.id.to_owned(), self.config(None)?.settings))
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
    /// As [`EnvArgs::named`], with an empty id where no environment was named.
    pub(super) fn named(&self, registry: &Registry) -> Result<(String, Map<String, Json>), Failure> {
        let (env, env_options) = (self.env.clone().unwrap_or_default(), self.env_options.clone());
        match env.as_str() {
            "" => Ok((env, assignments(&env_options, "--env-option", json_value)?)),
            _ => EnvArgs { env, env_options }.named(registry),
        }
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

/// Prints that a part is done.
pub(super) fn part_done(
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

pub(super) fn assignment<'a>(text: &'a str, option: &str) -> Result<(&'a str, &'a str), Failure> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim(), value.trim())),
        _ => Err(usage(format!("{option} {text}: write NAME=VALUE"))),
    }
}

/// The values of an option that is given as `NAME=VALUE`, by name.
pub(super) fn assignments(
    given: &[String],
    option: &str,
    value: impl Fn(&str) -> Json,
) -> Result<Map<String, Json>, Failure> {
    let one = |text: &String| assignment(text, option).map(|(name, text)| (name.to_owned(), value(text)));
    given.iter().map(one).collect()
}

/// JSON if it is JSON, else text.
pub(super) fn json_value(text: &str) -> Json {
    serde_json::from_str(text).unwrap_or_else(|_| Json::String(text.to_owned()))
}
