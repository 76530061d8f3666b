//! One episode, as its environment sees it at reset: its seed, and what was asked for.

use std::collections::BTreeMap;

use super::{EnvSpec, FactorSpec};
use crate::batch::Value;
use crate::error::EnvError;
use crate::seed::EpisodeSeed;

/// What a reset is asked for: the scenario of an episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResetOptions {
    /// Factors to sample: what [`FactorSpec::is_selected_by`] takes, such as names, groups, or `all`. `None`: the environment's
    /// default list.
    pub variation: Option<Vec<String>>,
    /// Factors to set, by name. They override sampled values.
    pub variation_values: BTreeMap<String, Value>,
    /// The state to start from: columns of a recorded step (see [`EnvSpec::start_columns`]).
    pub start: Option<BTreeMap<String, Value>>,
    /// The goal: columns of a recorded row (see [`EnvSpec::goal_columns`]).
    pub goal: Option<BTreeMap<String, Value>>,
    /// `[H, W, 3]` u8: the image of the goal, such as a recorded frame, in place of the one that the environment renders. In
    /// environments with images of goals, of this size.
    pub goal_image: Option<Value>,
    /// The episode seed, instead of the one that the run would give: for repeating a recorded episode.
    pub seed: Option<EpisodeSeed>,
}

impl ResetOptions {
    /// Samples these factors (names, groups, `*.` and the end of a name, `default` or `all`) and no others; a further call adds to
    /// them. `+NAME` samples the default factors, too; `none` alone samples nothing, and beside other names it is an error of the reset
    /// ([`ResetOptions::check_none`]). So it is in the command (`--vary`), in requests and in Python (`variation`).
    ///
    /// ```
    /// use swm_core::ResetOptions;
    ///
    /// let asked = |names: &[&str]| ResetOptions::default().vary(names).variation.unwrap();
    /// assert_eq!(asked(&["agent", "block.color"]), ["agent", "block.color"]);
    /// assert_eq!(asked(&["+block.color"]), ["default", "block.color"]);
    /// assert!(asked(&["none"]).is_empty());
    /// ```
    #[must_use]
    pub fn vary<S: AsRef<str>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        let names: Vec<S> = names.into_iter().collect();
        let asked = self.variation.get_or_insert_default();
        if let [name] = &names[..]
            && name.as_ref() == "none"
        {
            return self;
        }
        for name in names.iter().map(AsRef::as_ref) {
            let added = name.strip_prefix('+').filter(|name| !name.is_empty());
            if added.is_some() && !asked.iter().any(|name| name == "default") {
                asked.insert(0, "default".to_owned());
            }
            asked.push(added.unwrap_or(name).to_owned());
        }
        self
    }

    /// Sets one factor, which is then not sampled: numbers, a list of them, or the name of a choice. So it is in the command
    /// (`--set`), in requests and in Python (`variation_values`).
    ///
    /// ```
    /// use swm_core::{ResetOptions, Value};
    ///
    /// let options = ResetOptions::default().set("agent.color", [255, 0, 0]).set("block.shape", "square");
    /// assert_eq!(options.variation_values["agent.color"], Value::vector(&[255_i64, 0, 0]));
    /// ```
    #[must_use]
    pub fn set(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.variation_values.insert(name.to_owned(), value.into());
        self
    }

    /// Refuses a `none` beside other names, which contradict it. `env` is for the message. A [`World`](crate::World) and factors of
    /// `swm-fov` check it at every reset.
    ///
    /// # Errors
    ///
    /// [`EnvError::Reset`].
    pub fn check_none(&self, env: &str) -> Result<(), EnvError> {
        let asked = self.variation.as_deref().unwrap_or_default();
        if asked.len() < 2 || !asked.iter().any(|name| name == "none") {
            return Ok(());
        }
        let reason = format!(
            "`none` samples nothing, and is beside other names of factors to sample ({}); leave out `none`, or the others",
            asked.join(", ")
        );
        Err(EnvError::Reset { env: env.to_owned(), reason })
    }

    /// Names of the factors that keep their default values because others were asked for by name: they are sampled by default,
    /// and neither sampled nor set here. None where nothing is to be sampled.
    pub fn unsampled_defaults<'a>(&self, factors: &'a [FactorSpec]) -> Vec<&'a str> {
        if self.variation.as_ref().is_some_and(Vec::is_empty) {
            return Vec::new();
        }
        let is_left = |factor: &&FactorSpec| {
            factor.sampled_by_default
                && !self.variation_values.contains_key(&factor.name)
                && !factor.is_sampled(self.variation.as_deref())
        };
        factors.iter().filter(is_left).map(|factor| factor.name.as_str()).collect()
    }
}

/// One episode, as its environment sees it at reset.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Episode<'a> {
    /// Where its randomness comes from.
    pub seed: EpisodeSeed,
    /// What was asked for.
    pub options: &'a ResetOptions,
}

impl<'a> Episode<'a> {
    /// The episode of `seed`, reset as `options` say.
    pub fn new(seed: EpisodeSeed, options: &'a ResetOptions) -> Self {
        Self { seed, options }
    }

    /// The values that `column` has in the recorded row to [start](ResetOptions::start) from, `[…shape]` of the field of `spec` with
    /// this name; `None` where no start is given.
    ///
    /// ```
    /// # use swm_core::{EnvError, EnvSpec, Episode};
    /// # struct Point { spec: EnvSpec, position: f64, goal: f64 }
    /// # impl Point {
    /// fn place(&mut self, episode: &Episode<'_>) -> Result<(), EnvError> {
    ///     self.position = episode.start(&self.spec, "state")?.map_or(-0.5, |state| state[0]);
    ///     self.goal = episode.goal(&self.spec, "state")?.map_or(0.5, |state| state[0]);
    ///     Ok(())
    /// }
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// [`EnvError::Reset`]: the row lacks the column, or has values of another shape or that are not finite.
    pub fn start(&self, spec: &EnvSpec, column: &str) -> Result<Option<Vec<f64>>, EnvError> {
        recorded(spec, "start", self.options.start.as_ref(), column)
    }

    /// As [`Episode::start`], of the recorded [goal](ResetOptions::goal).
    ///
    /// # Errors
    ///
    /// As of [`Episode::start`].
    pub fn goal(&self, spec: &EnvSpec, column: &str) -> Result<Option<Vec<f64>>, EnvError> {
        recorded(spec, "goal", self.options.goal.as_ref(), column)
    }
}

/// The values of `column` in a recorded row, as the field of `spec` has them.
fn recorded(
    spec: &EnvSpec,
    what: &str,
    row: Option<&BTreeMap<String, Value>>,
    column: &str,
) -> Result<Option<Vec<f64>>, EnvError> {
    let Some(row) = row else { return Ok(None) };
    let refuse = |reason: String| EnvError::Reset { env: spec.id.clone(), reason };
    let field = spec.fields.iter().find(|field| field.name == column);
    let field = field.ok_or_else(|| refuse(format!("it has no field `{column}`")))?;
    let value = row.get(column).ok_or_else(|| refuse(format!("a {what} needs the column `{column}`")))?;
    let values = value.cast(column, field.dtype, &field.shape).and_then(|value| value.to_f64s(column));
    let values = values.map_err(|error| refuse(format!("the {what}'s {error}")))?;
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(Some(values)),
        false => Err(refuse(format!("the {what}'s `{column}` is not finite"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Dtype, Field};
    use crate::space::Space;

    #[test]
    fn recorded_starts_and_goals_are_those_of_the_field() {
        let action = Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0);
        let spec = EnvSpec::new("demo/Point-v0", action, vec![Field::step("state", Dtype::F64, &[2])]);
        let row = |values: &[f64]| Some(BTreeMap::from([("state".to_owned(), Value::vector(values))]));
        let options = ResetOptions { start: row(&[0.5, 1.0]), ..ResetOptions::default() };
        let episode = Episode::new(EpisodeSeed::new(1), &options);
        assert_eq!(episode.start(&spec, "state").unwrap(), Some(vec![0.5, 1.0]));
        assert_eq!(episode.goal(&spec, "state").unwrap(), None);
        for (options, column, reason) in [
            (
                ResetOptions { goal: row(&[1.0]), ..ResetOptions::default() },
                "state",
                "the goal's `state` must be",
            ),
            (
                ResetOptions { goal: row(&[f64::NAN, 0.0]), ..ResetOptions::default() },
                "state",
                "is not finite",
            ),
            (ResetOptions { goal: row(&[1.0, 0.0]), ..ResetOptions::default() }, "pose", "no field `pose`"),
            (
                ResetOptions { goal: Some(BTreeMap::new()), ..ResetOptions::default() },
                "state",
                "needs the column",
            ),
        ] {
            let episode = Episode::new(EpisodeSeed::new(1), &options);
            let message = episode.goal(&spec, column).unwrap_err().to_string();
            assert!(
                message.starts_with("cannot reset `demo/Point-v0`: ") && message.contains(reason),
                "{message}"
            );
        }
    }
}
