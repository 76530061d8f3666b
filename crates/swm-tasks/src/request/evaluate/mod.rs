//! A policy is evaluated: in new episodes, from starts and goals of a dataset, or on a manifest.

mod on_manifest;
mod online;

use std::path::PathBuf;

use serde_json::{Map, Value as Json, json};
use swm_core::settings::Settings as _;
use swm_core::{Evaluation, Registry};
use swm_data::OpenOptions;

use super::policy::policy_args;
use super::source::{check_opening, video_format_of};
use super::{
    Fix, Foreign, ImageChoice, ManifestSource, Message, NUM_ENVS, Report, Request, Shard, TaskError,
};
use crate::evaluation::Receipt;
use crate::threads;

swm_core::settings! {
    /// Evaluate a policy: online, from starts and goals of a dataset, or on a manifest.
    pub struct Evaluate {
        /// The environment's id.
        env: String = String::new() => "that of the manifest",
        /// Settings of the environment, by name.
        ///
        /// They are laid over those of the dataset.
        env_option: Map<String, Json> = Map::new() => "none",
        /// Evaluate on this manifest.
        manifest: Option<ManifestSource> = None => "none",
        /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = String::new() => "must be given",
        /// With a manifest: seed of the policy's noise, for repetitions on the same pairs. 0: noise is seeded by the pairs.
        policy_seed: u64 = 0,
        /// With a manifest: reference policies to evaluate on the same pairs: random, no-op, oracle, `all` or `none`.
        reference: Vec<String> = vec!["all".to_owned()] => "all",
        /// With a manifest: the planner to use as the oracle.
        oracle: Option<String> = None => "the policy's own planner on the true dynamics, or `cem`",
        /// With a manifest: actions of one plan, for the cost of plans.
        plan_steps: Option<u64> = None => "by the settings of the policy, or 25",
        /// Episodes to evaluate.
        episodes: u64 = 50,
        /// Seed of starts, goals and policy.
        seed: u64 = 42,
        /// Take starts and goals from this dataset.
        dataset: Option<PathBuf> = None => "none",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// With a dataset: the goal is this many steps after the start.
        goal_offset: usize = 25,
        /// Actions allowed per episode.
        budget: Option<u64> = None => "200, or 50 with a dataset",
        /// How often each action is applied per step.
        frame_skip: Option<u32> = None => "1, or the dataset's",
        /// Image size.
        image_size: Option<ImageChoice> = None => "that of the policy's model; else 128x128 with a folder, or none",
        /// Factors to sample per episode: names, groups, `*.color`, `default`, `all` or `none`; `+NAME` adds to the default ones.
        vary: Option<Vec<String>> = None => "the default factors",
        /// Factors to set, by name: numbers, or names of colors and choices.
        set: Map<String, Json> = Map::new() => "none",
        /// Environments stepped in parallel; results do not depend on it.
        num_envs: usize = NUM_ENVS => "8",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// A folder for the result: receipt.json with a manifest, else result.json, images and videos.
        out: Option<PathBuf> = None => "none",
        /// Run again what the folder holds already, and replace it.
        again: bool = false,
        /// With a manifest: run only this part of the episodes.
        shard: Option<Shard> = None => "all",
        /// With a manifest: join the parts that are in the folder.
        join: bool = false,
        /// With a folder: episodes to record as videos.
        videos: u64 = 4,
        /// With a folder: kind of video, mp4 or gif.
        video_format: Option<String> = None => "mp4 where this build can make it",
    }
}

/// What came out of an evaluation.
#[derive(Debug)]
#[non_exhaustive]
pub enum Evaluated {
    /// The receipt of an evaluation on a manifest, and its file.
    Receipt(Box<Receipt>, Option<PathBuf>),
    /// A part of one, of so many episodes, is done.
    Part(Shard, u64),
    /// Episodes without a manifest. The files that were written, or why one of them could not be.
    Episodes(Box<Evaluation>, Result<Vec<PathBuf>, TaskError>),
}

/// What a manifest fixes.
const OF_MANIFEST: &[&str] = &[
    "env",
    "env_option",
    "episodes",
    "seed",
    "dataset",
    "goal_offset",
    "budget",
    "frame_skip",
    "image_size",
    "vary",
    "set",
    "videos",
    "video_format",
];

/// What is about evaluations on a manifest, and what takes its place without one.
const WITH_MANIFEST: &[(&str, Option<&str>)] = &[
    ("policy_seed", Some("seed")),
    ("oracle", Some("policy")),
    ("reference", Some("policy")),
    ("plan_steps", None),
    ("shard", None),
    ("join", None),
];

impl Request for Evaluate {
    const NAME: &'static str = "evaluate";
    type Outcome = Evaluated;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        if self.policy.is_empty() {
            return Err(Message::about_setting("policy", "must be given").into());
        }
        self.check_manifest()?;
        self.check_bounds()?;
        threads::check(self.threads)?;
        check_parts(self.out.is_some(), self.again, self.shard, self.join)?;
        self.roles()?;
        if self.manifest.is_none() {
            let entry = registry.env(&self.env)?;
            registry.policy_entry(entry, &policy_args(registry, &self.policy)?.name)?;
        }
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Evaluated, TaskError> {
        self.run_by(registry, None, report)
    }
}

impl Evaluate {
    /// As [`Request::run`], by a policy that the registry does not have, where one is given: on a manifest.
    ///
    /// # Errors
    ///
    /// As of [`Request::run`]; a foreign policy without a manifest.
    pub fn run_by(
        &self,
        registry: &Registry,
        foreign: Option<&mut Foreign<'_>>,
        report: &mut dyn Report,
    ) -> Result<Evaluated, TaskError> {
        self.check(registry)?;
        match (&self.manifest, foreign) {
            (Some(source), foreign) => self.on_manifest(source.read()?, registry, foreign, report),
            (None, Some(_)) => Err(Message::about_setting("manifest", "must be given").into()),
            (None, None) => self.online(registry, report),
        }
    }

    /// Refuses what the manifest fixes, and what needs one where there is none.
    fn check_manifest(&self) -> Result<(), TaskError> {
        let changed = self.changed();
        let value = |name: &str| changed.get(name).cloned();
        if self.manifest.is_some() {
            if let Some(&option) = self.opening.given().first() {
                let message = Message::about_setting(option, "the manifest fixes it");
                let fixes = vec![Fix::Leave(option), Fix::Leave("manifest")];
                return Err(message.fix(Fix::Any(fixes)).into());
            }
            check_fixed(&changed, OF_MANIFEST)?;
            return Ok(());
        }
        for &(name, instead) in WITH_MANIFEST {
            if let Some(value) = value(name) {
                let message = Message::about(name, value, "is for evaluations on a manifest");
                let fixes = [Some(Fix::give("manifest")), instead.map(Fix::give)];
                return Err(message.fix(Fix::Any(fixes.into_iter().flatten().collect())).into());
            }
        }
        if self.env.is_empty() {
            let fix = Fix::Any(vec![Fix::give("env"), Fix::give("manifest")]);
            return Err(Message::new("nothing names the environment").fix(fix).into());
        }
        check_opening(self.dataset.is_some(), &self.opening)?;
        if let (Some(offset), None) = (value("goal_offset"), &self.dataset) {
            let message = Message::about("goal_offset", offset, "is about a dataset, and none is named");
            return Err(message.fix(Fix::Any(vec![Fix::give("dataset"), Fix::Leave("goal_offset")])).into());
        }
        Ok(())
    }

    fn check_bounds(&self) -> Result<(), TaskError> {
        for (name, is_zero, text) in [
            ("num_envs", self.num_envs == 0, "use 1 to 65536"),
            ("episodes", self.episodes == 0, "nothing is evaluated; use 1 or more"),
            ("budget", self.budget == Some(0), "no action is allowed; use 1 or more"),
            ("goal_offset", self.goal_offset == 0, "every start would be its goal; use 1 or more"),
        ] {
            if is_zero {
                return Err(Message::about(name, 0, text).into());
            }
        }
        video_format_of(self.video_format.as_deref()).map(drop)
    }
}

/// Refuses settings that a manifest fixes, of those that were given.
pub(super) fn check_fixed(given: &Map<String, Json>, fixed: &[&'static str]) -> Result<(), TaskError> {
    let mut fixed = fixed.iter().filter_map(|&name| Some((name, given.get(name)?)));
    fixed.next().map_or(Ok(()), |(name, value)| {
        let message = Message::about(name, value.clone(), "the manifest fixes it");
        Err(message.fix(Fix::Any(vec![Fix::Leave(name), Fix::Leave("manifest")])).into())
    })
}

/// Refuses parts that could not be joined.
pub(super) fn check_parts(
    has_folder: bool,
    again: bool,
    shard: Option<Shard>,
    join: bool,
) -> Result<(), TaskError> {
    let given = [
        ("shard", shard.map(|shard| json!(shard)), true),
        ("join", join.then(|| json!(true)), true),
        ("again", again.then(|| json!(true)), false),
    ];
    let mut parts = given.into_iter().filter_map(|(name, value, divides)| Some((name, value?, divides)));
    let Some((name, value, divides)) = parts.next() else { return Ok(()) };
    if !has_folder {
        let message = Message::about(name, value, "is about a folder, and none is named");
        return Err(message.fix(Fix::give("out")).into());
    }
    match parts.next() {
        Some((other, ..)) if divides => {
            let text =
                "computes one part, joins the parts, or repeats a whole result; these exclude each other";
            let message = Message::about(name, value, text);
            Err(message.fix(Fix::Any(vec![Fix::Leave(name), Fix::Leave(other)])).into())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
