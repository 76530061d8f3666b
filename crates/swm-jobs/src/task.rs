//! What a task finds in its environment, where a scheduler started it: its entry, the scheduler's job and the time that is left.

use std::env;
use std::time::Instant;

use crate::error::JobError;
use crate::files::node;
use crate::log::Attempt;

/// Where schedulers say which task it is, and the number that is the first one's.
const INDEX_VARIABLES: &[(&str, u64)] = &[
    ("SLURM_ARRAY_TASK_ID", 1),
    ("HQ_TASK_ID", 1),
    ("JOB_COMPLETION_INDEX", 0),
    ("AWS_BATCH_JOB_ARRAY_INDEX", 0),
    ("PBS_ARRAY_INDEX", 1),
    ("SGE_TASK_ID", 1),
];
/// Where schedulers say which job it is. Requeued, it is the same.
const ENGINE_VARIABLES: &[(&str, &str)] =
    &[("slurm", "SLURM_ARRAY_JOB_ID"), ("slurm", "SLURM_JOB_ID"), ("hq", "HQ_JOB_ID")];
/// Who started a task without a scheduler.
const NOBODY: &str = "hand";
/// Starts by the same job without a new episode, after which it is given up.
const MAX_IDLE_STARTS: usize = 3;

/// The entry of this task, counted from 1, where a scheduler gives it.
pub fn entry() -> Option<u64> {
    INDEX_VARIABLES.iter().find_map(|(name, first)| {
        let index: u64 = env::var(name).ok()?.parse().ok()?;
        Some(index + 1 - first)
    })
}

/// Seconds until the scheduler ends a task that started then, where it is known.
pub fn time_left(started: Instant) -> Option<f64> {
    let limit: f64 = env::var("SWM_TIME_LIMIT").ok()?.parse().ok()?;
    Some(limit - started.elapsed().as_secs_f64())
}

/// The scheduler's job that this process belongs to.
fn engine_job() -> String {
    let found = ENGINE_VARIABLES.iter().find_map(|(engine, name)| {
        Some(format!("{engine} {}", env::var(name).ok().filter(|id| !id.is_empty())?))
    });
    found.unwrap_or_else(|| NOBODY.to_owned())
}

impl Attempt {
    /// The start by this process of a shard with so many committed episodes.
    pub fn after(earlier: &[Self], committed: u64) -> Self {
        let number = earlier.last().map_or(0, |last| last.number) + 1;
        Self { number, node: node(), engine: engine_job(), held: committed }
    }

    /// Checks that the scheduler does not start a shard again and again without an episode more.
    ///
    /// # Errors
    ///
    /// It does.
    pub fn check_progress(&self, earlier: &[Self]) -> Result<(), JobError> {
        let is_idle = |earlier: &&Self| earlier.engine == self.engine && earlier.held == self.held;
        let starts = earlier.iter().rev().take_while(is_idle).count();
        match self.engine != NOBODY && starts >= MAX_IDLE_STARTS {
            true => Err(JobError::NoProgress { engine: self.engine.clone(), starts }),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scheduler_that_starts_a_shard_in_vain_is_stopped() {
        let attempt =
            |engine: &str, held| Attempt { number: 1, node: "n".into(), engine: engine.into(), held };
        let check = |engine: &str, held: [u64; 3]| {
            attempt(engine, 4).check_progress(&held.map(|held| attempt(engine, held))).is_ok()
        };
        assert!(check("slurm 7", [3, 4, 4]) && check(NOBODY, [4, 4, 4]));
        assert!(!check("slurm 7", [4, 4, 4]));
    }
}
