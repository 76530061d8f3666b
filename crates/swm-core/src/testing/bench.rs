//! What the checks act on: an environment and a table of one row.

use crate::batch::{Batch, Schema, Value};
use crate::env::{Env, EnvConfig, Episode, Outcome, ResetOptions};
use crate::error::EnvError;
use crate::registry::EnvEntry;
use crate::seed::EpisodeSeed;

/// Seeds tried for one whose samples meet all constraints.
const TRIES: u64 = 30;

/// An environment with one row to write into.
pub(super) struct Bench {
    pub(super) env: Box<dyn Env>,
    pub(super) row: Batch,
}

impl Bench {
    pub(super) fn new(entry: &EnvEntry, config: &EnvConfig) -> Result<Self, String> {
        let env = entry.make(config).map_err(|e| format!("cannot be made: {e}"))?;
        let schema = Schema::new(env.spec().fields.clone()).map_err(|e| e.to_string())?;
        Ok(Self { env, row: Batch::new(schema, 1) })
    }

    pub(super) fn reset(&mut self, seed: u64, options: &ResetOptions) -> Result<Outcome, String> {
        self.try_reset(seed, options).map_err(|e| format!("reset with seed {seed}: {e}"))
    }

    fn try_reset(&mut self, seed: u64, options: &ResetOptions) -> Result<Outcome, EnvError> {
        let outcome = self.env.reset(&Episode::new(EpisodeSeed::new(seed), options))?;
        self.env.write_episode(&mut self.row.rows_mut());
        self.env.observe(&mut self.row.rows_mut());
        Ok(outcome)
    }

    /// Resets with the first seed from `first` on whose samples go together: a factor sampled alone may break a
    /// constraint of one that keeps its default, which is a reset's error and no fault of the environment.
    pub(super) fn reset_from(
        &mut self,
        first: u64,
        options: &ResetOptions,
    ) -> Result<(u64, Outcome), String> {
        let mut last = String::new();
        for seed in first..first + TRIES {
            match self.try_reset(seed, options) {
                Ok(outcome) => return Ok((seed, outcome)),
                Err(error @ EnvError::Constraint { .. }) => last = error.to_string(),
                Err(error) => return Err(format!("reset with seed {seed}: {error}")),
            }
        }
        Err(format!("resets with seeds {first} to {} all fail: {last}", first + TRIES - 1))
    }

    pub(super) fn step(&mut self, seed: u64, step: usize) -> Result<Outcome, String> {
        let outcome = self.step_unobserved(seed, step)?;
        self.env.observe(&mut self.row.rows_mut());
        Ok(outcome)
    }

    /// As [`Bench::step`], but the row stays as it was.
    pub(super) fn step_unobserved(&mut self, seed: u64, step: usize) -> Result<Outcome, String> {
        let mut rng = EpisodeSeed::new(seed).indexed("conformance actions", [step as u64, 0]);
        let action = self.env.spec().action.sample(&mut rng);
        self.env.step(action.data.as_slice()).map_err(|e| format!("step {step}: {e}"))
    }

    /// What a step led to, as numbers with names; NaN where there is none.
    pub(super) fn outcome(&self, outcome: &Outcome) -> [(&'static str, f64); 4] {
        [
            ("reward", outcome.reward),
            ("terminated", f64::from(u8::from(outcome.terminated))),
            ("success", outcome.success.map_or(f64::NAN, |success| f64::from(u8::from(success)))),
            ("task_cost", self.env.task_cost().unwrap_or(f64::NAN)),
        ]
    }

    /// Resets, steps, and returns every row on the way.
    pub(super) fn trajectory(
        &mut self,
        seed: u64,
        options: &ResetOptions,
        steps: usize,
    ) -> Result<Vec<Batch>, String> {
        self.reset(seed, options)?;
        let mut rows = vec![self.row.clone()];
        for step in 0..steps {
            self.step(seed, step)?;
            rows.push(self.row.clone());
        }
        Ok(rows)
    }
}

/// A field of the first row, as a value.
pub(super) fn value_of(row: &Batch, field: &str) -> Value {
    let index = row.schema().index(field).expect("checked by spec_is_sound");
    Value::from_slice(&row.schema().fields()[index].shape, row.column(index))
}
