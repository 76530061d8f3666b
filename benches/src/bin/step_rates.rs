//! `step-rates [SECONDS [CASE [ENV]]]`: how often per second one environment steps and resets, as JSON. PushT unless ENV
//! says otherwise.
//!
//! The side of `peers/world.py` that runs in this process: the same cases as the reference's side in `reference.py`,
//! with the resets outside of the timed region, in CPU time. Rates of whole runs are `swm bench`'s.

use anyhow::{Context as _, Result};
use swm_benches::{Actions, BareEnv, EPISODE_STEPS, Image, Measurement, print, seconds, world_of};
use swm_core::{EnvEntry, ResetOptions};
use swm_envs_2d::ENVS;
use swm_envs_2d::pusht::PUSHT;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let seconds = seconds(arguments.next())?;
    let only = arguments.next();
    let id = arguments.next().unwrap_or_else(|| PUSHT.id.to_owned());
    let entry = ENVS.iter().find(|entry| entry.id == id).with_context(|| format!("no environment `{id}`"))?;
    let wanted = |case: &str| only.as_deref().is_none_or(|only| only == case);
    let mut measurements = Vec::new();
    // What else acts is PushT's own.
    let actions = if id == PUSHT.id { &Actions::ALL[..] } else { &[Actions::Random] };
    for &actions in actions {
        let case = format!("step/bare/{}", actions.name());
        if id == PUSHT.id && wanted(&case) {
            measurements.push(bare(case, actions, seconds)?);
        }
        for image in Image::ALL {
            let case = format!("step/{}/{}", image.name(), actions.name());
            if wanted(&case) {
                measurements.push(world_steps(case, entry, image, actions, seconds)?);
            }
            let case = format!("reset/{}/{}", image.name(), actions.name());
            if wanted(&case) {
                measurements.push(world_resets(case, entry, image, actions, seconds)?);
            }
        }
    }
    print(&measurements)
}

/// `Env::step` and `Env::observe`, no world around them.
fn bare(case: String, actions: Actions, seconds: f64) -> Result<Measurement> {
    let mut env = BareEnv::new()?;
    Measurement::repeat(case, EPISODE_STEPS as u64, seconds, |episode, clock| {
        let actions = env.actions(episode, actions)?;
        env.reset(episode)?;
        clock.time(|| actions.iter().try_for_each(|&action| env.step(action).map(|_| ())))
    })
}

/// `World::step` of one environment: policy, step, image, infos.
fn world_steps(
    case: String,
    entry: &'static EnvEntry,
    image: Image,
    actions: Actions,
    seconds: f64,
) -> Result<Measurement> {
    let mut world = world_of(entry, image, actions.name(), 1, 1)?;
    Measurement::world_steps(case, &mut world, seconds)
}

/// `World::reset` of one environment: factors, world, both images. As many as an episode has steps count as one.
fn world_resets(
    case: String,
    entry: &'static EnvEntry,
    image: Image,
    actions: Actions,
    seconds: f64,
) -> Result<Measurement> {
    let (mut world, options) = (world_of(entry, image, actions.name(), 1, 1)?, ResetOptions::default());
    Measurement::repeat(case, EPISODE_STEPS as u64, seconds, |episode, clock| {
        let first = episode * EPISODE_STEPS as u64;
        clock.time(|| {
            (first..first + EPISODE_STEPS as u64).try_for_each(|seed| world.reset(seed, &options))
        })?;
        Ok(())
    })
}
