//! `image_rates ENV SIDE FRAMES [THREADS]`: steps an environment and renders every state, `FRAMES` times on each thread.
//!
//! It prints nothing but what it did; how long that took, the caller measures (`benches/peers/render3d.py`).

use std::error::Error;

use swm_core::{Batch, EnvConfig, EnvEntry, Episode, EpisodeSeed, ImageSize, ResetOptions, Schema, Slice};
use swm_envs_mujoco::ENVS;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [id, side, frames, rest @ ..] = arguments.as_slice() else {
        return Err("usage: image_rates ENV SIDE FRAMES [THREADS]".into());
    };
    let (side, frames): (usize, u32) = (side.parse()?, frames.parse()?);
    let threads: u64 = rest.first().map_or(Ok(1), |text| text.parse())?;
    let entry =
        ENVS.iter().find(|entry| entry.id == id).ok_or_else(|| format!("unknown environment {id}"))?;
    std::thread::scope(|scope| {
        let run =
            |seed| scope.spawn(move || video(entry, side, frames, seed).map_err(|error| error.to_string()));
        let videos: Vec<_> = (0..threads).map(run).collect();
        videos.into_iter().try_for_each(|video| video.join().map_err(|_| "a thread panicked".to_owned())?)
    })?;
    println!("{} images of {side} x {side} px", threads * u64::from(frames));
    Ok(())
}

/// One control step and one image per frame, from the same start, without an action.
fn video(entry: &EnvEntry, side: usize, frames: u32, seed: u64) -> Result<(), Box<dyn Error>> {
    let mut config =
        EnvConfig { image: Some(ImageSize { height: side, width: side }), ..EnvConfig::default() };
    if entry.settings.iter().any(|setting| setting.name == "action_repeat") {
        config.settings.insert("action_repeat".to_owned(), 1.into());
    }
    let mut env = entry.make(&config)?;
    let mut row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
    let options = ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
    let episode = Episode::new(EpisodeSeed::new(seed), &options);
    env.reset(&episode)?;
    let (wide, narrow) = (vec![0.0_f64; env.spec().action.dim()], vec![0.0_f32; env.spec().action.dim()]);
    let is_narrow = env.spec().action.dtype() == Some(swm_core::Dtype::F32);
    for _ in 0..frames {
        if env.is_truncated() {
            env.reset(&episode)?;
        }
        env.step(if is_narrow { Slice::F32(&narrow) } else { Slice::F64(&wide) })?;
        env.observe(&mut row.rows_mut());
    }
    Ok(())
}
