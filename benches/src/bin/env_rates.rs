//! `env-rates ENV [SECONDS]`: steps and resets per second of any environment in a world of one, without images and with
//! images of 64 × 64 px, as JSON. For the comparisons of environments in `peers`; PushT has `step-rates`.

use anyhow::{Context as _, Result};
use swm_benches::{Image, Measurement, print, seconds, world_of};
use swm_core::{Registry, ResetOptions};

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let id = arguments.next().context("usage: env-rates ENV [SECONDS]")?;
    let seconds = seconds(arguments.next())?;
    let registry =
        Registry::new().with(swm_envs_2d::ENVS).with(swm_envs_3d::ENVS).with(swm_envs_mujoco::ENVS);
    let entry = registry.env(&id)?;
    // Random pushes end an episode of CartPole after some 20 steps.
    let policy = if id.contains("CartPole") { "expert" } else { "random" };
    let mut measurements = Vec::new();
    let has_styles = entry.settings.iter().any(|setting| setting.name == "render");
    let styles = if has_styles { &["exact", "fast"][..] } else { &["exact"] };
    let images = styles.iter().map(|style| Image { side: 64, style });
    for image in [Image::NONE].into_iter().chain(images) {
        let mut world = world_of(entry, image, policy, 1, 1)?;
        let name = image.name();
        measurements.push(Measurement::world_steps(format!("step/{name}"), &mut world, seconds)?);
        measurements.push(Measurement::repeat(format!("reset/{name}"), 1, seconds, |episode, clock| {
            Ok(clock.time(|| world.reset(episode, &ResetOptions::default()))?)
        })?);
    }
    print(&measurements)
}
