//! `env-rates ENV [SECONDS]`: steps and resets per second of any two-dimensional environment in a world of one, with
//! pictures of 64 × 64 px, as JSON. For `peers/two_room_v2.py`; PushT has `step-rates`.

use anyhow::{Context as _, Result};
use serde::Serialize;
use swm_benches::{Clock, EPISODE_STEPS, Elapsed, Picture, world_of};
use swm_core::{Registry, ResetOptions};
use swm_envs_2d::ENVS;

/// One measurement, in processor time of one thread.
#[derive(Serialize)]
struct Measurement {
    /// `step/64/exact`, `reset/64/fast`.
    case: String,
    /// Steps or resets.
    count: u64,
    #[serde(flatten)]
    elapsed: Elapsed,
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().context("usage: env-rates ENV [SECONDS]")?;
    let seconds =
        arguments.next().map_or(Ok(1.0), |text| text.parse()).context("SECONDS must be a number")?;
    let entry = Registry::new().with_envs(ENVS).env(&id)?;
    let mut measurements = Vec::new();
    for style in ["exact", "fast"] {
        let picture = Picture { side: 64, style };
        let mut world = world_of(entry, picture, "random", 1, 1)?;
        let name = picture.name();
        measurements.push(repeat(
            format!("step/{name}"),
            EPISODE_STEPS as u64,
            seconds,
            |episode, clock| {
                world.reset(episode, &ResetOptions::default())?;
                Ok(clock.time(|| (0..EPISODE_STEPS).try_for_each(|_| world.step()))?)
            },
        )?);
        measurements.push(repeat(format!("reset/{name}"), 1, seconds, |episode, clock| {
            Ok(clock.time(|| world.reset(episode, &ResetOptions::default()))?)
        })?);
    }
    println!("{}", serde_json::to_string_pretty(&measurements)?);
    Ok(())
}

/// Repeats `work`, which counts for `each`, until its timed parts took `seconds`. The first time does not count.
fn repeat(
    case: String,
    each: u64,
    seconds: f64,
    mut work: impl FnMut(u64, &mut Clock) -> Result<()>,
) -> Result<Measurement> {
    work(0, &mut Clock::new())?;
    let (mut clock, mut done) = (Clock::new(), 0);
    while clock.elapsed().cpu_s < seconds {
        done += 1;
        work(done, &mut clock)?;
    }
    Ok(Measurement { case, count: done * each, elapsed: clock.elapsed() })
}
