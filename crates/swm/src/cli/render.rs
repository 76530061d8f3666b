//! `swm render`: an image or video of an episode.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use swm_core::{Registry, Rollout, World};
use swm_media::{Clip, Format};
use swm_tasks::request::Ask;

use super::args::{EnvArgs, ImageArg, WorldArgs, policy};
use super::output::{counted, create_parent};
use super::scenario::ScenarioArgs;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};
use crate::video::Video;

/// Render an episode: `.png` its last frame, `.gif` and `.mp4` all of it.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm render swm/PushT-v1 --seed 3 --steps 0 --out start.png
  swm render swm/PushT-v1 --policy expert --steps 100 --out expert.mp4
  swm render swm/PushT-v1 --vary all --set block.shape=7 --steps 50 --out varied.gif")]
pub(super) struct Render {
    #[command(flatten)]
    env: EnvArgs,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long, default_value = "random")]
    policy: String,
    /// Seed of the run.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Steps to take; 0 shows the state after reset.
    #[arg(long, default_value_t = 50)]
    steps: u64,
    /// Image size, HEIGHTxWIDTH.
    #[arg(long, default_value = "224x224")]
    image_size: ImageArg,
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    pub(super) threads: ThreadsArg,
    /// The file to write: .png, .gif or .mp4. One that exists is replaced.
    #[arg(long, short)]
    out: PathBuf,
}

impl Render {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Some(size) = self.image_size.0 else {
            return Err(usage("an image needs a size; remove `none`"));
        };
        let format = Format::from_path(&self.out).map_err(usage)?;
        let entry = self.env.entry(registry)?;
        let config = self.env.config(Some(size))?;
        let world = WorldArgs { num_envs: 1, threads: self.threads, frame_skip: None };
        let mut world = World::new(entry, world.options(config, self.steps.max(1)))?;
        world.set_policy(policy(registry, &self.policy, &world, Ask::Here, output)?)?;
        let mut video = Video::first(1);
        let rollout = Rollout::new(0..1).seed(self.seed).options(self.scenario.options(
            entry,
            &world.spec().factors,
            output,
        )?);
        world.run(&rollout, &mut video)?;
        let (_, scene) = video.scenes().next().ok_or("the episode has no images")?;
        let wanted = usize::try_from(self.steps)?.saturating_add(1);
        let skipped = if format == Format::Png { wanted.min(scene.clip.len()) - 1 } else { 0 };
        let mut clip = Clip::new(size.height, size.width, scene.clip.frames_per_second());
        for frame in scene.clip.frames().take(wanted).skip(skipped) {
            clip.push(frame)?;
        }
        create_parent(&self.out)?;
        clip.save(&self.out)?;
        let result =
            json!({"out": self.out, "frames": clip.len(), "height": size.height, "width": size.width});
        let end = scene.end.as_ref().filter(|_| scene.clip.len() < wanted);
        let end = end.map_or("", |end| match end.success {
            Some(true) => "; the episode ended with success",
            _ => "; the episode ended",
        });
        output.result(&result, || {
            format!("wrote {} ({}{end})", self.out.display(), counted(clip.len(), "frame"))
        })
    }
}
