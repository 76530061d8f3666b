//! World models that need no training: the environment itself in its state space, exact or with actions that are too strong or
//! too weak, and one in which nothing ever changes. Yardsticks for measures of quality, and for learned models.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::batch::{Batch, Column, Dtype, Row, Schema, Slice, Value};
use crate::env::{Env, EnvConfig, EnvSpec, Episode, ResetOptions};
use crate::error::BoxError;
use crate::moments::{Moments, of_rows};
use crate::registry::EnvEntry;
use crate::seed::{EpisodeSeed, keyed};
use crate::space::Space;

use super::quality::{WorldModel, latents};

/// A model whose latent is what an environment can be reset to: its start columns, one after another.
///
/// What a reset to these columns forgets (contacts, velocities that are not among them) the model does not know either: its
/// prediction is exact only where they are the whole state. Factors are the defaults.
pub struct StateModel {
    env: Box<dyn Env>,
    /// One row, to read from.
    row: Batch,
    action: ActionColumn,
    /// What actions are multiplied by; `None`: nothing ever changes.
    gain: Option<f64>,
    /// What numbers of the state are divided by, `[Z]`; empty: nothing.
    scales: Vec<f64>,
}

impl StateModel {
    /// For environments made by `entry` with `config`. `gain`: what actions are multiplied by, 1 for the true dynamics;
    /// `None`: nothing ever changes.
    ///
    /// # Errors
    ///
    /// The environment cannot be made, or cannot be reset to a recorded state.
    pub fn new(entry: &EnvEntry, config: &EnvConfig, gain: Option<f64>) -> Result<Self, BoxError> {
        let env = entry.make(&EnvConfig { image: None, settings: config.settings.clone() })?;
        if env.spec().start_columns.is_empty() {
            return Err(format!(
                "{} cannot be reset to a recorded state: it names no start columns",
                entry.id
            )
            .into());
        }
        let row = Batch::new(Schema::new(env.spec().fields.clone())?, 1);
        let action = ActionColumn::new(&env.spec().action);
        Ok(Self { env, row, action, gain, scales: Vec::new() })
    }

    /// With each number of the latent in units of its std over the rows of `episodes`: columns have units of their own (pixels, radians,
    /// pixels per second), and a distance between latents shall not be that of the largest. What does not vary stays.
    ///
    /// # Errors
    ///
    /// A row lacks a start column.
    pub fn standardized(mut self, episodes: &[Batch]) -> Result<Self, BoxError> {
        let dim = self.latent_dim();
        self.scales.clear();
        let mut all = Vec::new();
        for rows in episodes {
            all.extend(latents(&mut self, rows)?);
        }
        self.scales = of_rows(&all, dim).iter().map(Moments::divisor).collect();
        Ok(self)
    }
}

impl WorldModel for StateModel {
    fn latent_dim(&self) -> usize {
        let columns = self.env.spec().start_columns;
        columns
            .iter()
            .filter_map(|name| self.row.schema().index(name))
            .map(|i| self.row.schema().dim(i))
            .sum()
    }

    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        let mut rest = latent.iter_mut().zip(self.scales.iter().copied().chain(std::iter::repeat(1.0)));
        for name in self.env.spec().start_columns {
            let values = row.at(row.schema().require(name)?);
            for (index, (number, scale)) in (0..values.len()).zip(&mut rest) {
                *number = values.as_f64(index).ok_or_else(|| format!("`{name}` holds no numbers"))? / scale;
            }
        }
        Ok(())
    }

    fn predict(&mut self, latent: &mut [f64], action: &[f64]) -> Result<(), BoxError> {
        let Some(gain) = self.gain else { return Ok(()) };
        latent.iter_mut().zip(&self.scales).for_each(|(number, scale)| *number *= scale);
        let schema = Arc::clone(self.row.schema());
        let (mut start, mut taken) = (BTreeMap::new(), 0);
        for name in self.env.spec().start_columns {
            let field = &schema.fields()[schema.require(name)?];
            let numbers = &latent[taken..taken + field.dim()];
            taken += field.dim();
            start.insert((*name).to_owned(), Value { shape: field.shape.clone(), ..Value::vector(numbers) });
        }
        let options = ResetOptions { start: Some(start), ..defaults() };
        self.env.reset(&Episode::new(EpisodeSeed::new(0), &options))?;
        self.action.set(action.iter().map(|number| number * gain))?;
        self.env.step(self.action.as_slice())?;
        self.env.observe(&mut self.row.rows_mut());
        let row = std::mem::replace(&mut self.row, Batch::new(schema, 0));
        let encoded = self.encode(row.row(0), latent);
        self.row = row;
        encoded
    }
}

/// No factors but the defaults.
pub(super) fn defaults() -> ResetOptions {
    ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() }
}

/// What resets the environment to the state of `row`: its start columns.
pub(super) fn start_at(spec: &EnvSpec, row: Row<'_>) -> Result<BTreeMap<String, Value>, BoxError> {
    columns(spec.start_columns, row)
}

/// Columns of a row by name.
pub(super) fn columns(names: &[&str], row: Row<'_>) -> Result<BTreeMap<String, Value>, BoxError> {
    let value = |name: &&str| -> Result<(String, Value), BoxError> {
        let index = row.schema().require(name)?;
        let shape = &row.schema().fields()[index].shape;
        Ok(((*name).to_owned(), Value::from_slice(shape, row.at(index))))
    };
    names.iter().map(value).collect()
}

/// The environment's fields and `action`.
pub(super) fn rows_with_actions(spec: &EnvSpec) -> Result<Arc<Schema>, BoxError> {
    let mut fields = spec.fields.clone();
    let dtype = spec.action.dtype().unwrap_or(Dtype::F32);
    fields.push(crate::batch::Field::step("action", dtype, &[spec.action.dim()]));
    Ok(Schema::new(fields)?)
}

/// One action, of the type that its environment takes.
pub(super) struct ActionColumn {
    space: Space,
    values: Column,
}

impl ActionColumn {
    pub(super) fn new(space: &Space) -> Self {
        let values = Column::zeros(space.dtype().unwrap_or(Dtype::F32), space.dim());
        Self { space: space.clone(), values }
    }

    pub(super) fn as_slice(&self) -> Slice<'_> {
        self.values.as_slice()
    }

    /// Samples it, by seed, episode and step alone.
    pub(super) fn sample(&mut self, seed: u64, episode: u64, step: u64) {
        let mut rng = keyed(seed, "quality action", [episode, step]);
        self.space.sample_into(&mut rng, self.values.as_slice_mut());
    }

    /// Sets it to numbers; an error if its type cannot hold them.
    pub(super) fn set(&mut self, numbers: impl Iterator<Item = f64>) -> Result<(), BoxError> {
        let numbers: Vec<f64> = numbers.collect();
        let value = Value::vector(&numbers).cast("action", self.values.dtype(), &[self.values.len()])?;
        self.values = value.data;
        Ok(())
    }

    pub(super) fn to_f64s(&self) -> Vec<f64> {
        (0..self.values.len()).map(|index| self.as_slice().as_f64(index).unwrap_or(f64::NAN)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{DISCRETE_TOY, TOY};

    fn after(entry: &EnvEntry, gain: Option<f64>, action: f64) -> Result<f64, BoxError> {
        let mut model = StateModel::new(entry, &EnvConfig::default(), gain)?;
        assert_eq!(model.latent_dim(), 1);
        let mut latent = [2.0];
        model.predict(&mut latent, &[action])?;
        Ok(latent[0])
    }

    #[test]
    fn a_standardized_latent_is_in_units_of_its_std_and_predicts_the_same() {
        let mut model = StateModel::new(&TOY, &EnvConfig::default(), Some(1.0)).unwrap();
        let mut rows = Batch::new(model.row.schema().clone(), 2);
        let state = rows.schema().require("state").unwrap();
        for (row, value) in [1.0, 7.0].into_iter().enumerate() {
            rows.rows_mut().select(row).write(state, &[value]);
        }
        assert_eq!(latents(&mut model, &rows).unwrap(), [1.0, 7.0]);
        // The std of 1 and 7 is 3.
        let mut model = model.standardized(&[rows.clone()]).unwrap();
        let mut found = latents(&mut model, &rows).unwrap();
        assert_eq!(found, [1.0 / 3.0, 7.0 / 3.0]);
        model.predict(&mut found[..1], &[0.5]).unwrap();
        assert_eq!(found[0], 0.5);
    }

    #[test]
    fn predictions_are_those_of_the_environment() {
        assert_eq!(after(&TOY, Some(1.0), 0.5).unwrap(), 2.5);
        assert_eq!(after(&TOY, Some(0.5), 0.5).unwrap(), 2.25);
        assert_eq!(after(&TOY, None, 0.5).unwrap(), 2.0);
        assert_eq!(after(&DISCRETE_TOY, Some(1.0), -1.0).unwrap(), 1.0);
        assert!(after(&DISCRETE_TOY, Some(0.5), 1.0).is_err(), "half a category");
    }
}
