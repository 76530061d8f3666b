//! What `swm plan` plans for: new episodes of an environment, or a pair of a manifest.

use std::ops::Range;
use std::path::Path;

use serde_json::{Map, Value as Json};
use swm_core::{EnvEntry, ImageSize, Manifest, PolicyArgs, Recorder, Registry, Rollout, World, WorldError};
use swm_tasks::request::{Ask, note_training, note_training_on};

use super::args::{EnvArgs, model_image};
use super::output::counted;
use super::scenario::ScenarioArgs;
use super::{Failure, Output, usage};
use crate::distractors;
use crate::evaluation::{Candidate, env_of, read_manifest};

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
    /// New episodes, with images as the model of the policy sees them.
    pub(super) fn new_episodes(
        registry: &Registry,
        env: &EnvArgs,
        policy: &str,
        episodes: u64,
        seed: u64,
        budget: u64,
        frame_skip: u32,
    ) -> Result<Self, Failure> {
        if episodes == 0 {
            return Err(usage("0 episodes asked for; use 1 or more"));
        }
        let (entry, settings) = (env.entry(registry)?, env.config(None)?.settings);
        let image = model_image(registry, entry, policy);
        let episodes = 0..episodes;
        Ok(Self { entry, settings, image, budget, frame_skip, seed, episodes, manifest: None })
    }

    /// The pair of this index, as it is evaluated; or only its first plan.
    pub(super) fn pair(
        registry: &Registry,
        path: &Path,
        index: u64,
        plan_only: bool,
    ) -> Result<Self, Failure> {
        let mut manifest = read_manifest(path).map_err(usage)?;
        let pairs = manifest.pairs.len() as u64;
        if index >= pairs {
            let held = counted(pairs, "pair");
            let reason = format!("{} holds {held}, counted from 0", path.display());
            return Err(usage(format!("--pair {index}: {reason}; use 0 to {}", pairs.saturating_sub(1))));
        }
        if plan_only {
            manifest.budget = 1;
        }
        Ok(Self {
            entry: env_of(registry, &manifest).map_err(usage)?,
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
        output: &Output,
    ) {
        match &self.manifest {
            Some(manifest) => {
                note_training_on(registry, self.entry, manifest, args, &mut &*output);
            }
            None => note_training(registry, args, &world.into(), Ask::Here, &mut &*output),
        }
    }

    /// How the episodes are run. A scenario that cannot be, or a manifest that cannot be run, is found out here.
    pub(super) fn rollout(
        &self,
        world: &mut World,
        scenario: &ScenarioArgs,
        output: &Output,
    ) -> Result<Rollout, Failure> {
        let Some(manifest) = &self.manifest else {
            let options = scenario.options(self.entry, &world.spec().factors, output)?;
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
