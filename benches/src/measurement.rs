//! Measurements that programs print as JSON, for the scripts in `peers/` to read.

use anyhow::{Context as _, Result};
use serde::Serialize;
use swm_core::{ResetOptions, World};

use crate::{Clock, EPISODE_STEPS, Elapsed};

/// How often something was done, and how long that took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    /// What was done: `step/64/exact`, `reset/cheetah/agent.color`.
    pub case: String,
    /// Steps or resets.
    pub count: u64,
    /// What they took.
    #[serde(flatten)]
    pub elapsed: Elapsed,
}

impl Measurement {
    /// Repeats `work`, which counts for `each`, until its timed parts took `seconds` of CPU time. The first time does not
    /// count.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn repeat(
        case: String,
        each: u64,
        seconds: f64,
        mut work: impl FnMut(u64, &mut Clock) -> Result<()>,
    ) -> Result<Self> {
        work(0, &mut Clock::new())?;
        let (mut clock, mut done) = (Clock::new(), 0);
        while clock.elapsed().cpu_s < seconds {
            done += 1;
            work(done, &mut clock)?;
        }
        Ok(Self { case, count: done * each, elapsed: clock.elapsed() })
    }

    /// Steps of all environments of a world, with the resets between episodes outside of the timed part.
    ///
    /// # Errors
    /// If an environment fails.
    pub fn world_steps(case: String, world: &mut World, seconds: f64) -> Result<Self> {
        let each = (world.options().num_envs * EPISODE_STEPS) as u64;
        Self::repeat(case, each, seconds, |episode, clock| {
            world.reset(episode, &ResetOptions::default())?;
            Ok(clock.time(|| (0..EPISODE_STEPS).try_for_each(|_| world.step()))?)
        })
    }
}

/// The argument `SECONDS`, 1 if it is left out.
///
/// # Errors
/// If it is no number.
pub fn seconds(argument: Option<String>) -> Result<f64> {
    argument.map_or(Ok(1.0), |text| text.parse()).context("SECONDS must be a number")
}

/// Prints what was measured, as JSON.
///
/// # Errors
/// If a number cannot be written as JSON.
pub fn print(measurements: &[Measurement]) -> Result<()> {
    println!("{}", serde_json::to_string_pretty(measurements)?);
    Ok(())
}
