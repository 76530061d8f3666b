//! An environment as an agent sees it: vectors as one, an image, and actions as values in [-1, 1].

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::{Batch, Dtype, Field, Row, Schema, Slice, SliceMut, Space, World};
use swm_solvers::{ActionMap, ActionScale};

use super::agent::{AgentConfig, Observation};
use crate::error::BaselineError;
use crate::images::Images;
use crate::train::Scale;

/// Columns that are observed where none are named: the first of these that the environment has.
pub(super) const OBSERVED: [&str; 3] = ["observation", "state", "proprio"];

/// Which columns are observed, and the bounds of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Interface {
    /// The observed vectors, in their order.
    pub columns: Vec<String>,
    /// O: values of all of them together.
    pub observation_dim: usize,
    /// S: the side of the images, if the column [`PIXELS`] is observed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<usize>,
    /// How vectors are scaled, where they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<Scale>,
    /// `[A]`: lower bounds of an action.
    pub low: Vec<f64>,
    /// `[A]`: upper bounds.
    pub high: Vec<f64>,
}

impl Interface {
    /// Vectors of these columns, O values together, and actions between these bounds, `[A]` each.
    pub fn of_vectors(columns: Vec<String>, observation_dim: usize, [low, high]: [Vec<f64>; 2]) -> Self {
        Self { columns, observation_dim, image: None, scale: None, low, high }
    }

    /// That of an environment, with these columns observed, vectors and [`PIXELS`]; none: `observation`, `state` or `proprio`,
    /// whichever comes first.
    ///
    /// # Errors
    ///
    /// There is no such column, images are not square, or actions are not real numbers between bounds.
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
        let image = match columns.iter().any(|name| name == PIXELS) {
            true => match schema.index(PIXELS).map(|index| &schema.fields()[index].shape[..]) {
                Some(&[height, width, 3]) if height == width => Some(height),
                Some(shape) => {
                    return wrong(
                        "observe",
                        format!("`{PIXELS}` has the shape {shape:?}, not of a square color image"),
                    );
                }
                None => return wrong("observe", format!("it renders no `{PIXELS}`; leave the column out")),
            },
            false => None,
        };
        let vectors: Vec<String> = columns.iter().filter(|name| *name != PIXELS).cloned().collect();
        let columns: Vec<String> = match columns {
            [] => OBSERVED
                .iter()
                .find(|name| known().contains(name))
                .map(|name| (*name).to_owned())
                .into_iter()
                .collect(),
            _ => vectors,
        };
        if columns.is_empty() && image.is_none() {
            let reason =
                format!("none of {} is there; name columns: {}", OBSERVED.join(", "), known().join(", "));
            return wrong("observe", reason);
        }
        if let Some(name) = columns.iter().find(|name| !known().contains(&name.as_str())) {
            let reason =
                format!("no vector `{name}`; there are {}, and the image `{PIXELS}`", known().join(", "));
            return wrong("observe", reason);
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
        Ok(Self { columns, observation_dim, image, scale: None, low: low.clone(), high: high.clone() })
    }

    /// What is wrong within it for an agent of this config, if anything is.
    pub(super) fn check(&self, agent: &AgentConfig) -> Result<(), String> {
        let Self { observation_dim, image, scale, low, high, .. } = self;
        let dims = |name: &str, ours: usize, theirs: usize| match ours == theirs {
            true => Ok(()),
            false => Err(format!("`interface.{name}` has {ours} values, and the agent takes {theirs}")),
        };
        dims("observation_dim", *observation_dim, agent.observation_dim)?;
        dims("low", low.len(), agent.action_dim)?;
        dims("high", high.len(), agent.action_dim)?;
        if let Some(scale) = scale {
            dims("scale", scale.mean.len(), *observation_dim)?;
        }
        if *image != agent.image {
            return Err("`interface.image` is not the agent's `image`".to_owned());
        }
        if low.iter().zip(high).any(|(low, high)| !(low < high && (high - low).is_finite())) {
            return Err("`interface.low` and `interface.high` are no bounds".to_owned());
        }
        Ok(())
    }

    /// The observed columns, the image first: what [`Interface::new`] was given, or what it chose.
    pub fn observed(&self) -> Vec<String> {
        let image = self.image.map(|_| PIXELS.to_owned());
        image.into_iter().chain(self.columns.iter().cloned()).collect()
    }

    /// Bytes of a step in the replay buffer.
    pub fn step_bytes(&self) -> usize {
        self.schema().row_bytes()
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

    /// What is observed in a row. `vector` gets the values of vectors.
    ///
    /// # Errors
    ///
    /// The row lacks a column.
    pub fn observe<'a>(
        &self,
        row: Row<'a>,
        vector: &'a mut Vec<f32>,
    ) -> Result<Observation<'a>, BaselineError> {
        vector.clear();
        self.vectors(row, None, vector)?;
        self.scale.iter().for_each(|scale| scale.apply(vector));
        let image = self.image.map(|side| {
            let schema = row.schema();
            let index = schema.index(PIXELS);
            let shape = index.map(|index| &schema.fields()[index].shape[..]);
            match (index.map(|index| row.at(index)), shape) {
                (Some(Slice::U8(values)), Some(&[height, width, 3])) => {
                    Ok(Images { values, rows: 1, steps: 1, height, width, channels_last: true })
                }
                _ => {
                    let reason = format!(
                        "the agent learned from images, and none are rendered; leave their size out, or make it {side}x{side}"
                    );
                    Err(BaselineError::data(PIXELS, reason))
                }
            }
        });
        Ok(Observation { vector, image: image.transpose()? })
    }

    /// Appends the values of the vectors of a row, `[O]`, as they are; those of goals from the row `reached`, where there is one.
    pub(super) fn vectors(
        &self,
        row: Row<'_>,
        reached: Option<Row<'_>>,
        out: &mut Vec<f32>,
    ) -> Result<(), BaselineError> {
        for name in &self.columns {
            let (row, name) = match (reached, name.strip_prefix(GOAL_PREFIX)) {
                (Some(reached), Some(of)) => (reached, of),
                _ => (row, name.as_str()),
            };
            let index = row.schema().require(name);
            let values = row.at(index.map_err(|error| BaselineError::data(OBSERVATION, error.to_string()))?);
            out.extend((0..values.len()).map(|index| values.as_f64(index).unwrap_or(f64::NAN) as f32));
        }
        Ok(())
    }

    /// The columns of [`Interface::transitions`].
    pub(super) fn schema(&self) -> Arc<Schema> {
        let vector = |name, dim| Field::step(name, Dtype::F32, &[dim]);
        let mut fields = vec![vector(ACTION, self.action_dim()), vector(REWARD, 1), vector(TERMINATED, 1)];
        if self.observation_dim > 0 {
            fields.push(vector(OBSERVATION, self.observation_dim));
        }
        fields.extend(self.image.map(|side| Field::step(PIXELS, Dtype::U8, &[side, side, 3])));
        Schema::new(fields).expect("names that differ")
    }

    /// What an agent learns from an episode's rows: see [`super::Transitions`]. Missing actions and rewards are 0, and nothing ends
    /// where no column tells.
    pub(super) fn transitions(&self, rows: &Batch, goals: Goals) -> Result<Batch, BaselineError> {
        let mut out = Batch::new(self.schema(), rows.rows());
        let finite = |value: f64| if value.is_finite() { value as f32 } else { 0.0 };
        let column = |name: &'static str| {
            let index = rows.schema().require(name);
            index
                .map(|index| rows.column(index))
                .map_err(|error| BaselineError::data(name, error.to_string()))
        };
        let scale = self.scale();
        let (action, reward) = (column(ACTION)?, column(REWARD)?);
        let terminated = rows.schema().index(TERMINATED).map(|index| rows.column(index));
        let dim = self.action_dim();
        fill(&mut out, ACTION, |index| {
            finite(scale.to_plan(index % dim, action.as_f64(index).unwrap_or(f64::NAN)))
        });
        fill(&mut out, REWARD, |index| finite(reward.as_f64(index).unwrap_or(f64::NAN)));
        fill(&mut out, TERMINATED, |index| {
            finite(terminated.and_then(|ends| ends.as_f64(index)).unwrap_or(0.0))
        });
        if self.observation_dim > 0 {
            let mut vectors = Vec::with_capacity(rows.rows() * self.observation_dim);
            let reached = goals.reached(rows);
            (0..rows.rows()).try_for_each(|row| self.vectors(rows.row(row), reached, &mut vectors))?;
            self.scale.iter().for_each(|scale| scale.apply(&mut vectors));
            fill(&mut out, OBSERVATION, |index| vectors[index]);
        }
        if let Some(side) = self.image {
            let index = out.schema().require(PIXELS).expect("a column of the schema above");
            if !out.column_mut(index).copy_from(column(PIXELS)?) {
                let reason = format!(
                    "the dataset's images are not of {side} × {side} pixels; bring back the dataset that the run was begun with"
                );
                return Err(BaselineError::data(PIXELS, reason));
            }
        }
        Ok(out)
    }
}

/// Which goals an episode has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Goals {
    /// Those that were recorded.
    Recorded,
    /// What it reached at its end.
    Reached,
}

impl Goals {
    /// The row that goals are taken from, if not from the one that they are recorded in.
    pub(super) fn reached(self, rows: &Batch) -> Option<Row<'_>> {
        let last = rows.rows().checked_sub(1)?;
        (self == Self::Reached).then(|| rows.row(last))
    }
}

/// What the name of the column of a goal begins with.
pub(super) const GOAL_PREFIX: &str = "goal_";
pub(super) const OBSERVATION: &str = "observation";
pub(super) const ACTION: &str = "action";
pub(super) const REWARD: &str = "reward";
pub(super) const TERMINATED: &str = "terminated";

/// Fills a column of real numbers.
fn fill(out: &mut Batch, name: &str, value: impl Fn(usize) -> f32) {
    let index = out.schema().require(name).expect("a column of the interface's schema");
    if let SliceMut::F32(values) = out.column_mut(index) {
        values.iter_mut().enumerate().for_each(|(index, out)| *out = value(index));
    }
}
