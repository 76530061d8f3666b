//! Some episodes of a receipt, run again for their videos and plans. A receipt repeats bit for bit, so the video shows the
//! episode that was evaluated.

use std::sync::PoisonError;

use minijinja::{Value, context};
use swm_core::evaluate::{EpisodeResult, OutcomeRecorder};
use swm_core::{EnvConfig, EnvEntry, ImageSize, Registry, World};
use swm_media::Format;
use swm_solvers::stops_at_success;

use crate::distractors;
use crate::error::TaskError;
use crate::evaluation::{Receipt, can_be_made, env_of};
use crate::plan::{
    EpisodeSummary, Figures, PlanFigures, PlanSummary, Report, Watched, planner_of, render_figures,
};
use crate::svg::data_address;
use crate::video::{Scene, Video};

/// What a page shows besides its results.
#[derive(Clone, Copy, Debug)]
pub struct PageOptions {
    /// Videos of successes, and as many of failures, per result; 0: none is run again.
    pub videos: usize,
    /// Their format.
    pub format: Format,
    /// Plans with figures, per recorded episode.
    pub plans: usize,
}

impl Default for PageOptions {
    /// Three videos of each outcome and two plans; MP4 where this build makes it, else GIF.
    fn default() -> Self {
        let format = if Format::Mp4.is_built() { Format::Mp4 } else { Format::Gif };
        Self { videos: 3, format, plans: 2 }
    }
}

/// Height and width of videos where the manifest has no images.
const SIDE: usize = 192;
/// Elites of an iteration in figures.
const ELITES: usize = 16;

/// What running again gave.
#[derive(Default)]
pub(super) struct Replayed {
    pub(super) videos: Vec<VideoCard>,
    /// The pair, whether it was a success, and the figures of its plans.
    pub(super) plans: Vec<(usize, bool, Figures)>,
}

/// A video, as data addresses.
pub(super) struct VideoCard {
    pair: usize,
    success: bool,
    steps: u64,
    video: String,
    is_mp4: bool,
    goal: Option<String>,
}

impl VideoCard {
    /// For templates.
    pub(super) fn context(&self) -> Value {
        let address = |data: &String| Value::from_safe_string(data.clone());
        context! {
            pair => self.pair, success => self.success, steps => self.steps, video => address(&self.video),
            is_mp4 => self.is_mp4, goal => self.goal.as_ref().map(address),
        }
    }
}

/// Runs the first successes and the first failures again.
pub(super) fn replay(
    registry: &Registry,
    receipt: &Receipt,
    options: PageOptions,
    notes: &mut Vec<String>,
) -> Result<Replayed, TaskError> {
    let entry = env_of(registry, &receipt.manifest)?;
    let of = |success: bool| {
        let all = receipt.episodes.iter().enumerate();
        all.filter(move |(_, episode)| episode.success == success).map(|(pair, _)| pair).take(options.videos)
    };
    let mut replayed = Replayed::default();
    if options.videos > 0
        && let Err(reason) = can_be_made(registry, entry, &receipt.candidate)
    {
        notes.push(format!("{}: no videos: {reason}", receipt.candidate.policy));
        return Ok(replayed);
    }
    let (successes, failures): (Vec<usize>, Vec<usize>) = (of(true).collect(), of(false).collect());
    for pair in successes.iter().chain(&failures).copied() {
        let is_first = successes.first() == Some(&pair) || failures.first() == Some(&pair);
        let drawn = if is_first { options.plans } else { 0 };
        match episode(registry, entry, receipt, pair, options.format, drawn) {
            Ok((card, figures, same)) => {
                replayed.videos.extend(card);
                replayed.plans.extend(figures.map(|figures| (pair, successes.contains(&pair), figures)));
                if !same {
                    notes.push(format!(
                        "{}: episode {pair} gave another result when it was run again; `swm verify-result` says why",
                        receipt.candidate.policy
                    ));
                }
            }
            Err(error) => {
                notes.push(format!("{}: no video of episode {pair}: {error}", receipt.candidate.policy));
                break;
            }
        }
    }
    Ok(replayed)
}

type Shown = (Option<VideoCard>, Option<Figures>, bool);

fn episode(
    registry: &Registry,
    entry: &EnvEntry,
    receipt: &Receipt,
    pair: usize,
    format: Format,
    drawn: usize,
) -> Result<Shown, TaskError> {
    let Receipt { manifest, candidate, .. } = receipt;
    let image = manifest.image.unwrap_or(ImageSize { height: SIDE, width: SIDE });
    let config = EnvConfig { image: Some(image), settings: manifest.settings.clone() };
    let mut options = manifest.world(1, Some(1));
    options.env = config.clone();
    let mut world = World::new(entry, options)?;
    world.set_policy_seed(candidate.seed);
    world.set_transform(distractors::parse_all(&manifest.distractors)?);
    let mut policy = candidate.make(registry, entry, manifest)?;
    let planner = planner_of(policy.as_mut()).filter(|_| drawn > 0);
    let actions = planner.map(|planner| planner.actions(&world.spec().action)).transpose()?;
    let mut watched = None;
    match actions {
        None => {
            world.set_policy(policy)?;
        }
        Some(actions) => match Watched::new(policy, ELITES, swm_solvers::NoTrace) {
            Ok((policy, session)) => {
                world.set_policy(policy)?;
                watched = Some((session, actions));
            }
            Err(policy) => {
                world.set_policy(policy)?;
            }
        },
    }
    let (mut video, mut found) = (Video::first(1), None);
    let keep = |_, result: EpisodeResult| {
        found = Some(result);
        Ok(())
    };
    let mut outcome = OutcomeRecorder::new(receipt.plan_steps, None, keep);
    let index = pair as u64;
    let rollout = manifest.rollout(index..index + 1)?;
    world.run_pairs(manifest, &rollout, &mut (&mut video, &mut outcome))?;
    drop(outcome);
    let result = found.ok_or("the episode did not end")?;
    let figures = match watched {
        None => None,
        Some((session, actions)) => {
            let session = session.lock().unwrap_or_else(PoisonError::into_inner);
            let summary = PlanSummary {
                env: entry.id.to_owned(),
                policy: receipt.policy.clone(),
                seed: manifest.seed,
                frame_skip: manifest.frame_skip,
                episodes: vec![EpisodeSummary {
                    episode: index,
                    steps: result.steps,
                    success: Some(result.success),
                }],
                plans: PlanFigures::of(&session),
                wall_time_s: 0.0,
            };
            let (config, actions, session, summary) = (&config, &actions, &*session, &summary);
            let video = &video;
            let stops_at_success = stops_at_success(&candidate.policy);
            let report =
                Report { entry, config, actions, session, summary, video, format, drawn, stops_at_success };
            Some(render_figures(&report)?)
        }
    };
    let scene = video.scenes().next().map(|(_, scene)| scene);
    let card = scene.map(|scene| card(scene, pair, &result, format)).transpose()?;
    let same = receipt.episodes.get(pair).is_some_and(|recorded| recorded.is_repeated_by(&result));
    Ok((card, figures, same))
}

fn card(scene: &Scene, pair: usize, result: &EpisodeResult, format: Format) -> Result<VideoCard, TaskError> {
    let video = scene.clip.upscaled(SIDE).encode(format)?;
    let is_mp4 = format == Format::Mp4;
    let kind = if is_mp4 { "video/mp4" } else { "image/gif" };
    Ok(VideoCard {
        pair,
        success: result.success,
        steps: result.steps,
        video: data_address(kind, &video),
        is_mp4,
        goal: scene.goal_address()?,
    })
}
