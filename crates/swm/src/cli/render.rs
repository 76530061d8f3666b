//! `swm render`: an image or video of an episode.

use std::path::PathBuf;
use std::sync::LazyLock;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, Request as _};

use super::args::{EnvArgs, ImageArg};
use super::output::counted;
use super::reporter::Reporter;
use super::scenario::ScenarioArgs;
use super::threads::ThreadsArg;
use super::{Failure, Output};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Render> = LazyLock::new(request::Render::default);

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
    #[arg(long, default_value = DEFAULT.policy.as_str())]
    policy: String,
    /// Seed of the run.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    /// Steps to take; 0 shows the state after reset.
    #[arg(long, default_value_t = DEFAULT.steps)]
    steps: u64,
    /// Image size, HEIGHTxWIDTH.
    #[arg(long, default_value_t = ImageArg(DEFAULT.image_size))]
    image_size: ImageArg,
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    threads: ThreadsArg,
    /// The file to write: .png, .gif or .mp4. One that exists is replaced.
    #[arg(long, short)]
    out: PathBuf,
}

impl Render {
    /// What is asked for.
    fn request(&self, registry: &Registry, output: &Output) -> Result<request::Render, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        Ok(request::Render {
            env,
            env_option,
            policy: self.policy.clone(),
            seed: self.seed,
            steps: self.steps,
            image_size: self.image_size.0,
            vary: self.scenario.vary.clone(),
            set: self.scenario.set(output)?,
            threads: self.threads.count(),
            out: self.out.clone(),
        })
    }

    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = self.request(registry, output)?;
        let made = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        let end = made.end.as_ref().map_or("", |end| match end.success {
            Some(true) => "; the episode ended with success",
            _ => "; the episode ended",
        });
        output.result(&made, || {
            format!("wrote {} ({}{end})", made.out.display(), counted(made.frames, "frame"))
        })
    }
}
