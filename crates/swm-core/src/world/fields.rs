//! The fields that `World` itself writes, behind those of the environment. Those of the policy come last.

use crate::batch::{Dtype, Field, RowsMut};
use crate::checkpoint::Checkpoints;
use crate::env::{Env, EnvSpec, EnvState, Outcome};
use crate::error::{BatchError, EnvError};
use crate::run::{LiveEpisode, Progress};

/// Positions of the common fields in the infos: they stand behind the environment's own, in this order, and
/// those of the policy behind them.
#[derive(Clone, Copy, Debug)]
pub(super) struct CommonFields {
    pub action: usize,
    reward: usize,
    terminated: usize,
    truncated: usize,
    step_idx: usize,
    seed: usize,
    checkpoints: Option<Checkpoints>,
}

/// Names of the common fields, in their order.
const OF_WORLDS: [&str; 6] = ["action", "reward", "terminated", "truncated", "step_idx", "seed"];
/// Columns in which datasets number the episodes of their rows: a field of this name would be replaced when it is recorded.
const OF_DATASETS: [&str; 2] = ["ep_idx", "episode_idx"];

/// Refuses fields of the environment or the policy whose names are those of [datasets](OF_DATASETS) or of [worlds](OF_WORLDS).
pub(super) fn check_names(fields: &[Field]) -> Result<(), BatchError> {
    let is_reserved = |name: &str| OF_WORLDS.contains(&name) || OF_DATASETS.contains(&name);
    match fields.iter().find(|field| is_reserved(&field.name)) {
        Some(field) => Err(BatchError::ReservedField { name: field.name.clone() }),
        None => Ok(()),
    }
}

impl CommonFields {
    /// The environment's fields followed by the common ones.
    pub(super) fn append(spec: &EnvSpec, checkpoints: Option<Checkpoints>) -> (Vec<Field>, Self) {
        let first = spec.fields.len();
        let action_dtype = spec.action.dtype().unwrap_or(Dtype::F32);
        let [action, reward, terminated, truncated, step_idx, seed] = OF_WORLDS;
        let fields = spec.fields.iter().cloned().chain([
            Field::step(action, action_dtype, &spec.action.shape()),
            Field::step(reward, Dtype::F64, &[]),
            Field::step(terminated, Dtype::Bool, &[]),
            Field::step(truncated, Dtype::Bool, &[]),
            Field::step(step_idx, Dtype::I64, &[]),
            Field::episode(seed, Dtype::I64, &[]),
        ]);
        let fields = fields.chain(checkpoints.map(|checkpoints| checkpoints.field()));
        let common = Self {
            action: first,
            reward: first + 1,
            terminated: first + 2,
            truncated: first + 3,
            step_idx: first + 4,
            seed: first + 5,
            checkpoints,
        };
        (fields.collect(), common)
    }

    /// Position of the policy's first field.
    pub(super) fn of_policy(&self) -> usize {
        self.seed + 1 + usize::from(self.checkpoints.is_some())
    }

    /// Writes the step's piece of a saved state, if states are saved. `saved` is the last one.
    pub(super) fn write_checkpoint(
        &self,
        env: &dyn Env,
        step: u64,
        saved: &mut EnvState,
        out: &mut RowsMut<'_>,
    ) -> Result<(), EnvError> {
        let Some(checkpoints) = self.checkpoints else { return Ok(()) };
        if checkpoints.is_at(step) {
            env.snapshot(saved)?;
        }
        checkpoints.write(saved, step, out.at(self.seed + 1));
        Ok(())
    }

    /// What only the policy knows is missing until it has acted.
    fn forget_policy(&self, out: &mut RowsMut<'_>) {
        out.slice_mut(self.action).fill_missing();
        for index in self.of_policy()..out.schema().fields().len() {
            out.slice_mut(index).fill_missing();
        }
    }

    pub(super) fn write_reset(&self, out: &mut RowsMut<'_>, episode: LiveEpisode) {
        self.forget_policy(out);
        out.write(self.reward, &[f64::NAN]);
        out.write(self.terminated, &[false]);
        out.write(self.truncated, &[false]);
        out.write(self.step_idx, &[0i64]);
        out.write(self.seed, &[episode.seed.value()]);
    }

    /// After a step, the row holds the new observation, which has no action yet: it is filled in when the policy
    /// has chosen one, and stays missing in the last step of an episode.
    pub(super) fn write_step(&self, out: &mut RowsMut<'_>, outcome: &Outcome, progress: &Progress) {
        self.forget_policy(out);
        out.write(self.reward, &[outcome.reward]);
        out.write(self.terminated, &[progress.terminated]);
        out.write(self.truncated, &[progress.truncated]);
        out.write(self.step_idx, &[progress.episode.step as i64]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_worlds_and_datasets_are_reserved() {
        let of = |name: &str| {
            check_names(&[Field::step("state", Dtype::F64, &[2]), Field::step(name, Dtype::I32, &[])])
        };
        for name in ["ep_idx", "episode_idx", "step_idx", "action"] {
            let message = of(name).unwrap_err().to_string();
            assert!(message.contains(&format!("`{name}`")) && message.contains("another name"), "{message}");
        }
        assert!(of("episode").is_ok());
    }
}
