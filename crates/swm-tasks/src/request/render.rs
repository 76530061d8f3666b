//! An image or a video of an episode.

use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::{EnvConfig, EpisodeEnd, ImageSize, Registry, Rollout, World, WorldOptions};
use swm_media::{Clip, Format};

use super::{
    Ask, Fix, Message, Report, Request, Scenario, TaskError, apart, create_parent, make_policy,
    must_be_given, policy_args, wrong,
};
use crate::threads::{self, within};
use crate::video::Video;

/// Size of images.
const IMAGE: ImageSize = ImageSize { height: 224, width: 224 };

swm_core::settings! {
    /// Render an episode: `.png` its last frame, `.gif` and `.mp4` all of it.
    pub struct Render {
        /// The environment's id.
        env: String = String::new() => "must be given",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = "random".to_owned() => "random",
        /// Seed of the run.
        seed: u64 = 0,
        /// Steps to take; 0 shows the state after reset.
        steps: u64 = 50,
        /// Image size.
        image_size: Option<ImageSize> = Some(IMAGE) => "224x224",
        /// Factors to sample per episode: names, groups, `*.color`, `default`, `all` or `none`; `+NAME` adds to the default ones.
        vary: Option<Vec<String>> = None => "the default factors",
        /// Factors to set, by name: numbers, or names of colors and choices.
        set: Map<String, Json> = Map::new() => "none",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// The file to write: .png, .gif or .mp4. One that exists is replaced.
        out: PathBuf = PathBuf::new() => "must be given",
    }
}

/// Images that were written.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct EpisodeImages {
    /// Their file.
    pub out: PathBuf,
    /// How many they are.
    pub frames: usize,
    /// Their height in pixels.
    pub height: usize,
    /// Their width in pixels.
    pub width: usize,
    /// How the episode ended, if it did before the steps were taken.
    #[serde(skip)]
    pub end: Option<EpisodeEnd>,
}

impl Request for Render {
    const NAME: &'static str = "render";
    type Outcome = EpisodeImages;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("env", self.env.is_empty()), ("out", self.out.as_os_str().is_empty())])?;
        if self.image_size.is_none() {
            let message = Message::about("image_size", "none", "an image needs a size");
            return Err(message.fix(Fix::Leave("image_size")).into());
        }
        threads::check(self.threads)?;
        Format::from_path(&self.out).map_err(wrong)?;
        Ok(registry.env(&self.env).map(drop)?)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<EpisodeImages, TaskError> {
        self.check(registry)?;
        let (size, format) = (self.image_size.unwrap_or(IMAGE), Format::from_path(&self.out).map_err(wrong)?);
        let env = EnvConfig { image: Some(size), settings: self.env_option.clone() };
        let options = WorldOptions::new(1).env(env).max_episode_steps(self.steps.max(1));
        let entry = registry.env(&self.env)?;
        let mut world = World::new(entry, options.threads(self.threads))?;
        world.set_policy(make_policy(
            registry,
            &policy_args(registry, &self.policy)?,
            &world,
            Ask::Here,
            report,
        )?)?;
        let scenario = Scenario { vary: self.vary.as_deref(), set: &self.set };
        let reset = scenario.options(entry, &world.spec().factors, report)?;
        let rollout = Rollout::new(0..1).seed(self.seed).options(reset).cancel(report.cancel());
        let mut video = Video::first(1);
        apart(report, || within(self.threads, || world.run(&rollout, &mut video)))???;
        let (_, scene) = video.scenes().next().ok_or("the episode has no images")?;
        let wanted = usize::try_from(self.steps)?.saturating_add(1);
        let skipped = if format == Format::Png { wanted.min(scene.clip.len()) - 1 } else { 0 };
        let mut clip = Clip::new(size.height, size.width, scene.clip.frames_per_second());
        for frame in scene.clip.frames().take(wanted).skip(skipped) {
            clip.push(frame)?;
        }
        create_parent(&self.out)?;
        clip.save(&self.out)?;
        let end = scene.end.filter(|_| scene.clip.len() < wanted);
        let (out, frames, ImageSize { height, width }) = (self.out.clone(), clip.len(), size);
        Ok(EpisodeImages { out, frames, height, width, end })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use swm_core::testing::TOY;

    use super::*;

    fn ask(given: &Json) -> Result<EpisodeImages, TaskError> {
        let registry = Registry::new().with(&[TOY]);
        Render::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, &mut ()))
    }

    #[test]
    fn every_refusal_names_the_setting_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a.png");
        let sizeless = json!({ "env": TOY.id, "out": out, "image_size": null });
        for (given, text, fix) in [
            (json!({ "out": out }), "env: must be given", None),
            (json!({ "env": TOY.id }), "out: must be given", None),
            (json!({ "env": TOY.id, "out": out, "step": 3 }), "did you mean `steps`?", None),
            (sizeless, "image_size=none: an image needs a size", Some(Fix::Leave("image_size"))),
            (json!({ "env": TOY.id, "out": out, "threads": 0 }), "threads=0: use 1 to 1024", None),
            (json!({ "env": TOY.id, "out": folder.path().join("a.bmp") }), "a.bmp", None),
            (json!({ "env": TOY.id, "out": out, "vary": ["point.gian"] }), "vary=point.gian: unknown", None),
        ] {
            let error = match ask(&given) {
                Err(error @ TaskError::Request(_)) => error,
                other => panic!("{given}: {other:?}"),
            };
            assert!(error.to_string().contains(text), "{text}: {error}");
            assert!(fix.is_none() || error.fix() == fix.as_ref(), "{error}");
        }
        assert!(!out.exists());
    }

    #[test]
    fn an_image_is_the_last_frame_and_a_video_has_all() {
        let folder = tempfile::tempdir().unwrap();
        let frames = |name: &str, steps: u64| {
            let size = json!({ "height": 16, "width": 24 });
            let out = folder.path().join("new").join(name);
            let made =
                ask(&json!({ "env": TOY.id, "steps": steps, "image_size": size, "out": out })).unwrap();
            assert_eq!((made.height, made.width, made.out.is_file()), (16, 24, true));
            made.frames
        };
        assert_eq!((frames("a.png", 3), frames("b.png", 0), frames("a.gif", 3)), (1, 1, 4));
    }
}
