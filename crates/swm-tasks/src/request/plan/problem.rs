//! What is planned for: new episodes of an environment, or a pair of a manifest.

use std::ops::Range;

use serde_json::{Map, Value as Json};
use swm_core::{EnvEntry, ImageSize, Manifest, PolicyArgs, Recorder, Registry, Rollout, World, WorldError};

use super::Plan;
use crate::distractors;
use crate::evaluation::{Candidate, env_of};
use crate::request::policy::model_image;
use crate::request::training_note::{Ask, note_training, note_training_on};
use crate::request::{ManifestSource, Message, Report, Scenario, TaskError, wrong};

/// Episodes to plan in.
pub(super) struct Problem {
    pub(super) entry: &'static EnvEntry,
    pub(super) settings: Map<String, Json>,
    /// The size of the images that the policy sees.
    pub(super) image: Option<ImageSize>,
    /// Actions allowed per episode.
    pub(super) budget: u64,
    pub(super) frame_skip: u32,
    pub(super) seed: u64,
    pub(super) episodes: Range<u64>,
    manifest: Option<Manifest>,
}

impl Problem {
    /// What a request asks for.
    pub(super) fn of(request: &Plan, registry: &Registry) -> Result<Self, TaskError> {
        match &request.manifest {
            Some(manifest) => Self::pair(request, registry, manifest),
            None => Self::new_episodes(request, registry),
        }
    }

    /// New episodes, with images as the model of the policy sees them.
    fn new_episodes(request: &Plan, registry: &Registry) -> Result<Self, TaskError> {
        let entry = registry.env(&request.env)?;
        Ok(Self {
            entry,
            settings: request.env_option.clone(),
            image: model_image(registry, entry, &request.policy),
            budget: if request.plan_only { 1 } else { request.budget },
            frame_skip: request.frame_skip,
            seed: request.seed,
            episodes: 0..request.episodes,
            manifest: None,
        })
    }

    /// A pair, as it is evaluated; or only its first plan.
    fn pair(request: &Plan, registry: &Registry, source: &ManifestSource) -> Result<Self, TaskError> {
        let mut manifest = source.read()?;
        let (pairs, index) = (manifest.pairs.len() as u64, request.pair.unwrap_or(0));
        if index >= pairs {
            let (s, last) = (if pairs == 1 { "" } else { "s" }, pairs.saturating_sub(1));
            let text = format!("the manifest holds {pairs} pair{s}, counted from 0; use 0 to {last}");
            return Err(Message::about("pair", index, text).into());
        }
        if request.plan_only {
            manifest.budget = 1;
        }
        Ok(Self {
            entry: env_of(registry, &manifest).map_err(wrong)?,
            settings: manifest.settings.clone(),
            image: manifest.image,
            budget: manifest.budget,
            frame_skip: manifest.frame_skip,
            seed: manifest.seed,
            episodes: index..index + 1,
            manifest: Some(manifest),
        })
    }

    /// The policy with the settings that an evaluation gives it.
    pub(super) fn policy(&self, registry: &Registry, args: PolicyArgs) -> PolicyArgs {
        match &self.manifest {
            Some(manifest) => Candidate::new(args).on(registry, self.entry, manifest).policy,
            None => args,
        }
    }

    /// A note where the model behind the policy was trained with other settings.
    pub(super) fn note_training(
        &self,
        registry: &Registry,
        args: &PolicyArgs,
        world: &World,
        report: &mut dyn Report,
    ) {
        match &self.manifest {
            Some(manifest) => note_training_on(registry, self.entry, manifest, args, report),
            None => note_training(registry, args, &world.into(), Ask::Here, report),
        }
    }

    /// How the episodes are run. A scenario that cannot be, or a manifest that cannot be run, is found out here.
    pub(super) fn rollout(
        &self,
        world: &mut World,
        scenario: Scenario<'_>,
        report: &mut dyn Report,
    ) -> Result<Rollout, TaskError> {
        let Some(manifest) = &self.manifest else {
            let options = scenario.options(self.entry, &world.spec().factors, report)?;
            world.reset(self.seed, &options)?;
            return Ok(Rollout::new(self.episodes.clone()).seed(self.seed).options(options));
        };
        manifest.check()?;
        world.set_transform(distractors::parse_all(&manifest.distractors)?);
        Ok(manifest.rollout(self.episodes.clone())?)
    }

    /// Runs the episodes.
    pub(super) fn run(
        &self,
        world: &mut World,
        rollout: &Rollout,
        recorder: &mut dyn Recorder,
    ) -> Result<(), WorldError> {
        match &self.manifest {
            Some(manifest) => world.run_pairs(manifest, rollout, recorder),
            None => world.run(rollout, recorder),
        }
    }
}
