//! Which pairs can have the values of a change: each is tried in an environment before anything is evaluated.

use std::collections::BTreeMap;

use swm_core::env::{FactorSpec, VARIATION_PREFIX};
use swm_core::evaluate::Pair;
use swm_core::{
    Batch, Env, EnvConfig, EnvEntry, EnvError, Episode, EpisodeSeed, Manifest, ResetOptions, Schema,
};

use super::changes::Change;
use crate::error::TaskError;

/// Halvings of the way from a value that cannot be to one that can.
const HALVINGS: usize = 16;

/// An environment that changes are tried in.
pub(super) struct Trial {
    env: Box<dyn Env>,
    pub(super) factors: Vec<FactorSpec>,
    /// One environment's row, for the values that a pair has without a change.
    row: Batch,
}

/// What became of a change in every pair.
pub(super) struct Tried {
    /// How the pair is reset; nothing where the values cannot be.
    resets: Vec<Option<ResetOptions>>,
    /// Pairs that get the nearest values which can be.
    moved: usize,
    /// The first refusal.
    reason: Option<String>,
}

impl Trial {
    pub(super) fn new(entry: &EnvEntry, manifest: &Manifest) -> Result<Self, TaskError> {
        let env = entry.make(&EnvConfig { image: None, settings: manifest.settings.clone() })?;
        let row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        Ok(Self { factors: env.spec().factors.clone(), row, env })
    }

    /// Tries a change in every pair, whose resets without it are `resets`. A given value that cannot be is moved toward that
    /// of the pair, until it can.
    pub(super) fn admit(
        &mut self,
        manifest: &Manifest,
        resets: &[ResetOptions],
        change: &Change,
    ) -> Result<Tried, TaskError> {
        let mut tried = Tried { resets: Vec::with_capacity(resets.len()), moved: 0, reason: None };
        for (pair, reset) in manifest.pairs.iter().zip(resets) {
            let asked = change.apply(&self.factors, reset, &BTreeMap::new(), 0.0);
            let Some(reason) = self.refusal(pair, &asked)? else {
                tried.resets.push(Some(asked));
                continue;
            };
            let nearest = self.nearest(pair, reset, change)?;
            tried.moved += usize::from(nearest.is_some());
            tried.resets.push(nearest);
            tried.reason.get_or_insert(reason);
        }
        Ok(tried)
    }

    /// The reset with the nearest values that can be, on the way to those of the pair.
    fn nearest(
        &mut self,
        pair: &Pair,
        reset: &ResetOptions,
        change: &Change,
    ) -> Result<Option<ResetOptions>, TaskError> {
        if !change.has_values() || self.refusal(pair, reset)?.is_some() {
            return Ok(None);
        }
        let own = self.own_values();
        let (mut refused, mut admitted, mut best) = (0.0, 1.0, None);
        for _ in 0..HALVINGS {
            let toward = 0.5 * (refused + admitted);
            let options = change.apply(&self.factors, reset, &own, toward);
            match self.refusal(pair, &options)? {
                Some(_) => refused = toward,
                None => (admitted, best) = (toward, Some(options)),
            }
        }
        Ok(best)
    }

    /// The factors of the last reset, by name.
    fn own_values(&mut self) -> BTreeMap<String, Vec<f64>> {
        self.env.write_episode(&mut self.row.rows_mut());
        let (row, schema) = (self.row.row(0), self.row.schema());
        let value = |factor: &FactorSpec| {
            let column = schema.index(&format!("{VARIATION_PREFIX}{}", factor.name))?;
            let values = row.at(column);
            let numbers = (0..values.len()).map(|at| values.as_f64(at)).collect::<Option<Vec<f64>>>()?;
            Some((factor.name.clone(), numbers))
        };
        self.factors.iter().filter_map(value).collect()
    }

    /// Why the environment does not take a reset, if it does not.
    fn refusal(&mut self, pair: &Pair, options: &ResetOptions) -> Result<Option<String>, TaskError> {
        match self.env.reset(&Episode::new(EpisodeSeed::new(pair.seed as u64), options)) {
            Ok(_) => Ok(None),
            Err(error @ (EnvError::Constraint { .. } | EnvError::Reset { .. })) => {
                Ok(Some(error.to_string()))
            }
            Err(error) => Err(error.into()),
        }
    }
}

impl Tried {
    /// The pairs that can have the values.
    pub(super) fn pairs(&self) -> Vec<usize> {
        let all = self.resets.iter().enumerate();
        all.filter(|(_, reset)| reset.is_some()).map(|(pair, _)| pair).collect()
    }

    /// A reset per pair; of those that cannot have the values, the one in `base`.
    pub(super) fn resets(&self, base: &[ResetOptions]) -> Vec<ResetOptions> {
        self.resets.iter().zip(base).map(|(reset, base)| reset.as_ref().unwrap_or(base).clone()).collect()
    }

    /// What is to be said of pairs that do not have the values that were asked for.
    pub(super) fn note(&self, count: usize) -> Option<String> {
        let reason = self.reason.as_ref()?;
        let valid = self.pairs().len();
        Some(match (valid, self.moved) {
            (0, _) => format!("cannot be: {reason}"),
            (_, 0) => format!("{valid} of {count} pairs; the others cannot be: {reason}"),
            (_, moved) if valid == count => {
                format!("nearest possible value in {moved} of {count} pairs: {reason}")
            }
            (_, moved) => {
                format!(
                    "{valid} of {count} pairs, {moved} with the nearest possible value; the others cannot be: {reason}"
                )
            }
        })
    }
}
