//! `table-rates ENV [SECONDS]`: how often per second an environment on MuJoCo steps and resets in a world of one, without
//! pictures and with, as JSON. For `peers/ogb.py`.

use anyhow::{Context as _, Result};
use serde::Serialize;
use swm_benches::{Clock, EPISODE_STEPS, Elapsed};
use swm_core::{EnvConfig, EnvEntry, ImageSize, Registry, ResetOptions, Value, World, WorldOptions, policy};
use swm_envs_mujoco::ENVS;

/// One measurement, in processor time of one thread.
#[derive(Serialize)]
struct Measurement {
    /// `step/none`, `step/64`, `reset/color`.
    case: String,
    /// Steps or resets.
    count: u64,
    #[serde(flatten)]
    elapsed: Elapsed,
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().context("usage: table-rates ENV [SECONDS]")?;
    let seconds =
        arguments.next().map_or(Ok(1.0), |text| text.parse()).context("SECONDS must be a number")?;
    let entry = Registry::new().with_envs(ENVS).env(&id)?;
    let mut measurements = Vec::new();
    for side in [None, Some(64), Some(224)] {
        let mut world = world_of_one(entry, side)?;
        let picture = side.map_or("none".to_owned(), |side| side.to_string());
        measurements.push(repeat(
            format!("step/{picture}"),
            EPISODE_STEPS as u64,
            seconds,
            |episode, clock| {
                world.reset(episode, &ResetOptions::default())?;
                Ok(clock.time(|| (0..EPISODE_STEPS).try_for_each(|_| world.step()))?)
            },
        )?);
        for (name, options) in scenarios() {
            measurements.push(repeat(format!("reset/{picture}/{name}"), 1, seconds, |episode, clock| {
                Ok(clock.time(|| world.reset(episode, &options(episode)))?)
            })?);
        }
    }
    println!("{}", serde_json::to_string_pretty(&measurements)?);
    Ok(())
}

/// What resets are asked for, by episode.
type Scenario = fn(u64) -> ResetOptions;

fn scenarios() -> [(&'static str, Scenario); 4] {
    // A number that differs from episode to episode.
    fn share(episode: u64) -> f64 {
        (episode % 17) as f64 / 17.0
    }
    [
        ("default", |_| ResetOptions::default()),
        ("color", |episode| {
            let color = Value::vector(&[share(episode), 0.5, 0.2]);
            ResetOptions::default()
                .fix("agent.color", color)
                .fix("light.intensity", Value::vector(&[share(episode)]))
        }),
        ("floor", |episode| {
            let colors = [share(episode), 0.1, 0.2, 0.3, 0.4, 0.5];
            let colors = Value { shape: vec![2, 3], ..Value::vector(&colors) };
            ResetOptions::default().fix("floor.color", colors)
        }),
        ("size", |episode| {
            ResetOptions::default().fix("cube.size", Value::vector(&[0.01 + 0.02 * share(episode)]))
        }),
    ]
}

fn world_of_one(entry: &'static EnvEntry, side: Option<usize>) -> Result<World> {
    let image = side.map(|side| ImageSize { height: side, width: side });
    let options = WorldOptions {
        env: EnvConfig { image, ..EnvConfig::default() },
        max_episode_steps: None,
        threads: Some(1),
        ..WorldOptions::default()
    };
    let mut world = World::new(entry, options)?;
    world.set_policy(policy::random());
    Ok(world)
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
