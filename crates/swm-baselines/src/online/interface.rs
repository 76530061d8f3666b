//! An environment as an agent sees it: observations as one vector, actions as values in [-1, 1].

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use swm_core::{Batch, Dtype, Field, Row, Schema, SliceMut, Space, World, WorldError};
use swm_solvers::{ActionMap, ActionScale};

use crate::error::BaselineError;

/// Columns that are observed where none are named: the first of these that the environment has.
const OBSERVED: [&str; 3] = ["observation", "state", "proprio"];

/// Which columns are observed, and the bounds of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Interface {
    /// The observed columns, in their order.
    pub columns: Vec<String>,
    /// O: values of all of them together.
    pub observation_dim: usize,
    /// `[A]`: lower bounds of an action.
    pub low: Vec<f64>,
    /// `[A]`: upper bounds.
    pub high: Vec<f64>,
}

impl Interface {
    /// That of an environment, with these columns observed; none: `observation`, `state` or `proprio`, whichever comes first.
    ///
    /// # Errors
    ///
    /// There is no such column, one is an image, or actions are not real numbers between bounds.
    pub fn new(world: &World, columns: &[String]) -> Result<Self, BaselineError> {
        let (spec, schema) = (world.spec(), world.infos().schema());
        let wrong = |setting: &str, reason: String| {
            Err(BaselineError::Training {
                setting: setting.to_owned(),
                reason: format!("{}: {reason}", spec.id),
            })
        };
        let is_vector =
            |field: &Field| field.shape.len() < 2 && !matches!(field.dtype, Dtype::Bool | Dtype::Str);
        let known = || -> Vec<&str> {
            spec.fields.iter().filter(|field| is_vector(field)).map(|field| field.name.as_str()).collect()
        };
        let columns: Vec<String> = match columns {
            [] => OBSERVED
                .iter()
                .find(|name| known().contains(name))
                .map(|name| (*name).to_owned())
                .into_iter()
                .collect(),
            named => named.to_vec(),
        };
        if columns.is_empty() {
            let reason =
                format!("none of {} is there; name columns: {}", OBSERVED.join(", "), known().join(", "));
            return wrong("observe", reason);
        }
        if let Some(name) = columns.iter().find(|name| !known().contains(&name.as_str())) {
            return wrong("observe", format!("no vector `{name}`; there are {}", known().join(", ")));
        }
        let Space::Box { low, high, .. } = &spec.action else {
            let reason =
                format!("actions are {}; agents need real numbers between bounds", spec.action.kind());
            return wrong("env", reason);
        };
        if low.iter().zip(high).any(|(low, high)| !(low < high && (high - low).is_finite())) {
            return wrong(
                "env",
                "an action has no bounds; agents need real numbers between bounds".to_owned(),
            );
        }
        let dim = |name: &String| schema.index(name).map_or(0, |index| schema.dim(index));
        let observation_dim = columns.iter().map(dim).sum();
        Ok(Self { columns, observation_dim, low: low.clone(), high: high.clone() })
    }

    /// A: values of an action.
    pub fn action_dim(&self) -> usize {
        self.low.len()
    }

    /// O and A.
    pub fn dims(&self) -> [usize; 2] {
        [self.observation_dim, self.action_dim()]
    }

    /// From an agent's values to actions of `space`.
    ///
    /// # Errors
    ///
    /// The space is another than the agent was made for.
    pub fn action_map(&self, space: &Space) -> Result<ActionMap, BaselineError> {
        let wrong = |reason: String| BaselineError::Training { setting: "env".to_owned(), reason };
        ActionMap::scaled(space, &self.scale(), true).map_err(|error| wrong(error.to_string()))
    }

    fn scale(&self) -> ActionScale {
        ActionScale::Percentile { low: self.low.clone(), high: self.high.clone() }
    }

    /// Appends the observation of a row, `[O]`, to `out`.
    ///
    /// # Errors
    ///
    /// The row lacks a column.
    pub fn observe(&self, row: Row<'_>, out: &mut Vec<f32>) -> Result<(), WorldError> {
        for name in &self.columns {
            let values = row.at(row.schema().require(name)?);
            out.extend((0..values.len()).map(|index| values.as_f64(index).unwrap_or(f64::NAN) as f32));
        }
        Ok(())
    }

    /// The columns of [`Interface::transitions`].
    pub(super) fn schema(&self) -> Arc<Schema> {
        let vector = |name, dim| Field::step(name, Dtype::F32, &[dim]);
        let fields = vec![
            vector(OBSERVATION, self.observation_dim),
            vector(ACTION, self.action_dim()),
            vector(REWARD, 1),
            vector(TERMINATED, 1),
        ];
        Schema::new(fields).expect("four names that differ")
    }

    /// What an agent learns from an episode's rows: see [`super::Transitions`]. Missing actions and rewards are 0.
    pub(super) fn transitions(&self, rows: &Batch) -> Result<Batch, BaselineError> {
        let mut out = Batch::new(self.schema(), rows.rows());
        let finite = |value: f64| if value.is_finite() { value as f32 } else { 0.0 };
        let missing = |error: swm_core::BatchError| BaselineError::data("observation", error.to_string());
        let scale = self.scale();
        let [action, reward, terminated] =
            ["action", "reward", "terminated"].map(|name| rows.schema().require(name).map_err(missing));
        let (action, reward, terminated) =
            (rows.column(action?), rows.column(reward?), rows.column(terminated?));
        let mut observations = Vec::with_capacity(rows.rows() * self.observation_dim);
        for row in 0..rows.rows() {
            self.observe(rows.row(row), &mut observations)?;
        }
        fill(&mut out, 0, |index| observations[index]);
        let dim = self.action_dim();
        fill(&mut out, 1, |index| {
            finite(scale.to_plan(index % dim, action.as_f64(index).unwrap_or(f64::NAN)))
        });
        fill(&mut out, 2, |index| finite(reward.as_f64(index).unwrap_or(f64::NAN)));
        fill(&mut out, 3, |index| finite(terminated.as_f64(index).unwrap_or(0.0)));
        Ok(out)
    }
}

pub(super) const OBSERVATION: &str = "observation";
pub(super) const ACTION: &str = "action";
pub(super) const REWARD: &str = "reward";
pub(super) const TERMINATED: &str = "terminated";

fn fill(out: &mut Batch, column: usize, value: impl Fn(usize) -> f32) {
    if let SliceMut::F32(values) = out.column_mut(column) {
        values.iter_mut().enumerate().for_each(|(index, out)| *out = value(index));
    }
}
