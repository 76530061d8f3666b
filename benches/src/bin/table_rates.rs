//! `table-rates ENV [SECONDS] [CASE]`: how often per second an environment on MuJoCo steps and resets in a world of one, without
//! images and with, as JSON; `CASE`: only cases that begin so. For `peers/ogb.py`.

use anyhow::{Context as _, Result};
use swm_benches::{Measurement, print, seconds};
use swm_core::{
    EnvConfig, EnvEntry, ImageSize, Registry, ResetOptions, Value, World, WorldOptions, policies,
};
use swm_envs_mujoco::ENVS;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().context("usage: table-rates ENV [SECONDS] [CASE]")?;
    let seconds = seconds(arguments.next())?;
    let wanted = arguments.next().unwrap_or_default();
    let entry = Registry::new().with(ENVS).env(&id)?;
    let mut measurements = Vec::new();
    for side in [None, Some(64), Some(224)] {
        let mut world = world_of_one(entry, side)?;
        let image = side.map_or("none".to_owned(), |side| side.to_string());
        let steps = format!("step/{image}");
        if steps.starts_with(&wanted) {
            measurements.push(Measurement::world_steps(steps, &mut world, seconds)?);
        }
        for (name, options) in scenarios() {
            let resets = format!("reset/{image}/{name}");
            if resets.starts_with(&wanted) {
                measurements.push(Measurement::repeat(resets, 1, seconds, |episode, clock| {
                    Ok(clock.time(|| world.reset(episode, &options(episode)))?)
                })?);
            }
        }
    }
    print(&measurements)
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
                .set("agent.color", color)
                .set("light.intensity", Value::vector(&[share(episode)]))
        }),
        ("floor", |episode| {
            let colors = [share(episode), 0.1, 0.2, 0.3, 0.4, 0.5];
            let colors = Value { shape: vec![2, 3], ..Value::vector(&colors) };
            ResetOptions::default().set("floor.color", colors)
        }),
        ("size", |episode| {
            ResetOptions::default().set("cube.size", Value::vector(&[0.01 + 0.02 * share(episode)]))
        }),
    ]
}

fn world_of_one(entry: &'static EnvEntry, side: Option<usize>) -> Result<World> {
    let image = side.map(|side| ImageSize { height: side, width: side });
    let options = WorldOptions::default()
        .env(EnvConfig { image, ..EnvConfig::default() })
        .max_episode_steps(None)
        .threads(1);
    let mut world = World::new(entry, options)?;
    world.set_policy(policies::random())?;
    Ok(world)
}
