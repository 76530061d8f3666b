//! An evaluation without a manifest: in new episodes, or from starts and goals of a dataset.

use swm_core::error::BoxError;
use swm_core::evaluate::GoalImages;
use swm_core::{
    EnvConfig, EpisodeEnd, EvalOptions, ImageSize, LiveStep, Recorder, Registry, Rollout, World, WorldOptions,
};
use swm_files::WriterLock;
use swm_media::Format;

use super::{Evaluate, Evaluated};
use crate::evaluation::refusal;
use crate::report::write_report;
use crate::request::policy::{make_policy, model_image, note_images, policy_args_on};
use crate::request::report::apart;
use crate::request::source::{
    check_built, check_recorded_in, claim, make_folder, open_dataset_with, video_format_of,
};
use crate::request::{
    Ask, BUDGET_DATASET, BUDGET_ONLINE, Fix, Message, Progress, Report, Scenario, Stage, TaskError,
    envs_at_most, wrong,
};
use crate::video::Video;

/// Largest side of a video, in pixels.
const MAX_VIDEO_SIDE: usize = 2160;

impl Evaluate {
    pub(super) fn online(
        &self,
        registry: &Registry,
        report: &mut dyn Report,
    ) -> Result<Evaluated, TaskError> {
        let entry = registry.env(&self.env)?;
        let recorded = self.out.as_ref().map(|_| ImageSize { height: 128, width: 128 });
        let of_model = model_image(registry, entry, &self.policy);
        let image = self.image_size.map_or(of_model.or(recorded), |size| size.0);
        note_images(&self.policy, of_model, image, report);
        let format = self.format_of_videos(image)?;
        let open = |path| open_dataset_with(registry, path, &self.opening);
        let mut dataset = self.dataset.as_deref().map(open).transpose()?;
        if let Some(dataset) = &dataset {
            check_recorded_in(dataset.as_ref(), entry, self.frame_skip)?;
        }
        let recorded = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned().unwrap_or_default();
        let mut settings = recorded.settings;
        settings.extend(self.env_option.clone());
        let frame_skip = self.frame_skip.unwrap_or(recorded.frame_skip.max(1));
        let budget = self.budget.unwrap_or(if dataset.is_some() { BUDGET_DATASET } else { BUDGET_ONLINE });
        let num_envs = envs_at_most(self.num_envs, self.episodes);
        let options =
            WorldOptions::new(num_envs).env(EnvConfig { image, settings }).max_episode_steps(budget);
        let mut world = World::new(entry, options.frame_skip(frame_skip).threads(self.threads))?;
        let ask = if dataset.is_some() { Ask::Dataset } else { Ask::Here };
        let args = policy_args_on(registry, entry, &self.policy, self.dataset.as_deref(), report)?;
        world.set_policy(make_policy(registry, &args, &world, ask, report)?)?;
        let factors = &world.spec().factors;
        let scenario = Scenario { vary: self.vary.as_deref(), set: &self.set };
        let reset = match &dataset {
            None => scenario.options(entry, factors, report)?,
            Some(_) => scenario.recorded_options(entry, factors, report)?,
        };
        // What is mistyped is found first: a folder that holds a result is no reason to look for another mistake.
        let _claim = self.claim_folder()?;
        let (name, unit) = (self.policy.as_str(), "episodes");
        let progress = report.begin(&Stage { name, role: None, unit, total: self.episodes })?;
        let video = Video::first(if self.out.is_some() { self.videos } else { 0 });
        let mut watch = (video, Counted(progress));
        let cancel = report.cancel();
        let evaluated = apart(report, || match &mut dataset {
            None => {
                let rollout = Rollout::new(0..self.episodes).seed(self.seed).cancel(&cancel);
                Ok::<_, TaskError>(world.evaluate_with(&rollout.options(reset), &mut watch)?)
            }
            Some(dataset) => {
                let options = EvalOptions {
                    episodes: usize::try_from(self.episodes)?,
                    goal_offset: self.goal_offset,
                    budget,
                    seed: self.seed,
                    variation: reset.variation.unwrap_or_default(),
                    variation_values: reset.variation_values,
                    cancel: Some(cancel),
                };
                Ok(world.evaluate_from_dataset_with(dataset, &options, &mut watch)?)
            }
        })?;
        let (video, progress) = watch;
        drop(progress);
        let evaluation = evaluated?;
        let goals = evaluation.protocol.as_ref().and_then(|protocol| protocol.goal_images.as_ref());
        if let Some(note) = goals.and_then(GoalImages::note) {
            report.note(&Message::new(note.clone()));
        }
        let written = match &self.out {
            Some(dir) => write_report(dir, &evaluation, &video, format),
            None => Ok(Vec::new()),
        };
        Ok(Evaluated::Episodes(Box::new(evaluation), written))
    }

    /// Refuses a folder that cannot be written, or that holds a result; no other process writes a result there while the lock lives.
    fn claim_folder(&self) -> Result<Option<WriterLock>, TaskError> {
        let Some(dir) = &self.out else { return Ok(None) };
        // Found out now, a folder that cannot be written costs nothing.
        let probe = dir.join(".writable");
        make_folder(dir)?;
        let lock = claim(&dir.join("result.json"))?;
        std::fs::write(&probe, "")
            .and_then(|()| std::fs::remove_file(&probe))
            .map_err(|error| wrong(format!("cannot write to the folder {}: {error}", dir.display())))?;
        for (file, what) in [
            ("result.json", "the result of an evaluation"),
            ("receipt.json", "the receipt of an evaluation on a manifest"),
        ] {
            if !self.again && dir.join(file).exists() {
                return Err(refusal(dir, &format!("{what}, {file}")));
            }
        }
        Ok(Some(lock))
    }

    /// The format of videos, checked before anything runs.
    fn format_of_videos(&self, image: Option<ImageSize>) -> Result<Format, TaskError> {
        let format = video_format_of(self.video_format.as_deref())?;
        if self.out.is_none() || self.videos == 0 {
            return Ok(format);
        }
        check_built(format)?;
        if let Some(ImageSize { height, width }) = image
            && height.max(width) > MAX_VIDEO_SIDE
        {
            let text = format!("videos hold images of up to {MAX_VIDEO_SIDE} pixels, not {height}x{width}");
            let fixes = vec![Fix::Change("image_size"), Fix::set("videos", 0)];
            return Err(Message::new(text).fix(Fix::Any(fixes)).into());
        }
        Ok(format)
    }
}

/// Counts episodes.
struct Counted(Box<dyn Progress>);

impl Recorder for Counted {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.0.done(end.success);
        Ok(())
    }
}
