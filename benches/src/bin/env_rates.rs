//! `env-rates ENV [SECONDS]`: steps and resets per second of any two-dimensional environment in a world of one, with
//! images of 64 × 64 px, as JSON. For `peers/two_room_v2.py`; PushT has `step-rates`.

use anyhow::{Context as _, Result};
use swm_benches::{Image, Measurement, print, seconds, world_of};
use swm_core::{Registry, ResetOptions};
use swm_envs_2d::ENVS;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().context("usage: env-rates ENV [SECONDS]")?;
    let seconds = seconds(arguments.next())?;
    let entry = Registry::new().with(ENVS).env(&id)?;
    let mut measurements = Vec::new();
    for style in ["exact", "fast"] {
        let image = Image { side: 64, style };
        let mut world = world_of(entry, image, "random", 1, 1)?;
        let name = image.name();
        measurements.push(Measurement::world_steps(format!("step/{name}"), &mut world, seconds)?);
        measurements.push(Measurement::repeat(format!("reset/{name}"), 1, seconds, |episode, clock| {
            Ok(clock.time(|| world.reset(episode, &ResetOptions::default()))?)
        })?);
    }
    print(&measurements)
}
