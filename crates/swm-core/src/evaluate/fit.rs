//! Whether the rows of a dataset of another program can be of an environment: what looks alike may be in other units.

use crate::batch::Column;
use crate::dataset::{Dataset, Steps};
use crate::env::EnvSpec;
use crate::error::BoxError;

/// Rows whose actions are looked at, in whole episodes all over the dataset.
const MAX_ROWS: usize = 100_000;
/// Of so many rows, one may have an action outside of the space: a controller may overshoot.
const ONE_OF: usize = 100;
/// Bounds may be missed by so much of their distance: files hold floats of 32 bits.
const TOLERANCE: f64 = 1e-5;

/// Refuses a dataset of another program whose rows do not fit an environment: one of the columns that a start or a goal is set from has
/// another number of values, actions have, or more than 1 % of them are outside of the space. What this program recorded passes, and so
/// does a dataset that lacks these columns.
///
/// # Errors
///
/// What does not fit, and what to do; or actions cannot be read.
pub fn check_fit(source: &mut dyn Dataset, spec: &EnvSpec) -> Result<(), BoxError> {
    let of_other =
        source.metadata().and_then(|run| run.source.as_ref()).is_some_and(|about| !about["format"].is_null());
    if !of_other && source.info().mapping.is_empty() {
        return Ok(());
    }
    for name in spec.start_columns.iter().chain(spec.goal_columns) {
        let own = spec.fields.iter().find(|field| field.name == *name);
        let theirs = source.schema().fields().iter().find(|field| field.name == *name);
        if let (Some(own), Some(theirs)) = (own, theirs)
            && own.dim() != theirs.dim()
        {
            let (id, own, theirs) = (&spec.id, own.dim(), theirs.dim());
            return Err(format!(
                "its `{name}` has {theirs} values a row, that of {id} has {own}: no start can be set from it; name the environment that the \
                 episodes are of, or another column by `map`"
            )
            .into());
        }
    }
    check_actions(source, spec)
}

fn check_actions(source: &mut dyn Dataset, spec: &EnvSpec) -> Result<(), BoxError> {
    let Some(column) = source.schema().index("action") else { return Ok(()) };
    let (field, (low, high)) = (source.info().field(column).clone(), spec.action.bounds());
    let (id, dim) = (&spec.id, field.dim());
    if dim != low.len() || dim == 0 {
        let text = format!(
            "its actions have {dim} values, those of {id} {}; name another column by `map`",
            low.len()
        );
        return Err(text.into());
    }
    let lengths = source.info().lengths.clone();
    let every = lengths.iter().sum::<usize>().div_ceil(MAX_ROWS).max(1);
    let (mut rows, mut outside, mut first) = (0, 0, None);
    for episode in (0..lengths.len()).step_by(every) {
        let steps = Steps { first: 0, count: lengths[episode].min(MAX_ROWS), stride: 1 };
        let mut values = Column::zeros(field.dtype, steps.count * dim);
        source.read_column(column, episode, steps, values.as_slice_mut())?;
        let values: Option<Vec<f64>> = (0..values.len()).map(|at| values.as_slice().as_f64(at)).collect();
        let Some(values) = values else {
            return Err(format!("its actions are {}, not numbers", field.dtype).into());
        };
        for (row, action) in values.chunks_exact(dim).enumerate() {
            // The last row of an episode has none.
            if action.iter().any(|value| value.is_nan())
                || (low.iter().all(|&low| low >= 0.0) && action == [-1.0])
            {
                continue;
            }
            rows += 1;
            let is_inside = action.iter().zip(low.iter().zip(&high)).all(|(value, (low, high))| {
                let margin = if (high - low).is_finite() { TOLERANCE * (high - low) } else { 0.0 };
                (low - margin..=high + margin).contains(value)
            });
            if !is_inside {
                outside += 1;
                first.get_or_insert_with(|| (episode, row, action.to_vec()));
            }
        }
    }
    match first {
        Some((episode, row, action)) if outside * ONE_OF > rows => {
            let percent = 100.0 * outside as f64 / rows as f64;
            let range = |values: &[f64], pick: fn(f64, f64) -> f64| {
                values.iter().copied().reduce(pick).unwrap_or(f64::NAN)
            };
            let (low, high) = (range(&low, f64::min), range(&high, f64::max));
            Err(format!(
                "{percent:.0} % of its actions are outside of the space of {id}, as {action:?} of row {row} of episode {episode}, where {low} to \
                 {high} are allowed: they are of another kind, such as targets; give the settings of the environment that takes them, or name \
                 another column by `map`"
            )
            .into())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use serde_json::json;

    use super::*;
    use crate::batch::{Dtype, Field, Schema, SliceMut};
    use crate::dataset::{DataError, DatasetInfo, Metadata};
    use crate::env::EnvConfig;
    use crate::testing::TOY;

    /// One episode, with these actions in rows of `dim` values, and states of so many values.
    #[derive(Clone)]
    struct Rows {
        info: DatasetInfo,
        actions: Vec<f32>,
    }

    impl Rows {
        fn new(actions: &[f32], dim: usize, state: usize) -> Self {
            let fields =
                vec![Field::step("action", Dtype::F32, &[dim]), Field::step("state", Dtype::F64, &[state])];
            let schema = Schema::new(fields).unwrap();
            let mut info = DatasetInfo::new(Path::new("rows"), "other", schema, vec![actions.len() / dim]);
            let source = Some(json!({ "format": "other" }));
            info.runs = Arc::new([(0, Metadata { source, ..Metadata::unknown() })]);
            Self { info, actions: actions.to_vec() }
        }

        fn refusal(&self) -> Option<String> {
            let env = TOY.make(&EnvConfig::default()).unwrap();
            check_fit(&mut self.clone(), env.spec()).err().map(|error| error.to_string())
        }
    }

    impl Dataset for Rows {
        fn info(&self) -> &DatasetInfo {
            &self.info
        }

        fn rows(&mut self, _: usize, _: usize, steps: Steps, out: SliceMut<'_>) -> Result<(), DataError> {
            let SliceMut::F32(out) = out else { panic!("only actions are read") };
            out.copy_from_slice(&self.actions[steps.first..steps.first + out.len()]);
            Ok(())
        }

        fn share(&self) -> Box<dyn Dataset> {
            Box::new(self.clone())
        }
    }

    #[test]
    fn rows_of_other_programs_have_to_fit() {
        let mut actions = vec![0.5; 300];
        assert_eq!(Rows::new(&actions, 1, 1).refusal(), None);
        actions[299] = f32::NAN;
        actions[7] = 400.0;
        assert_eq!(Rows::new(&actions, 1, 1).refusal(), None, "one of a hundred may overshoot");
        (7..11).for_each(|row| actions[row] = 400.0);
        let refused = Rows::new(&actions, 1, 1).refusal().unwrap();
        assert!(
            refused
                .contains("1 % of its actions are outside of the space of swm/Toy-v0, as [400.0] of row 7"),
            "{refused}"
        );
        let refused = Rows::new(&[0.5; 300], 1, 5).refusal().unwrap();
        assert!(refused.contains("its `state` has 5 values a row, that of swm/Toy-v0 has 1"), "{refused}");
        let refused = Rows::new(&[0.5; 300], 3, 1).refusal().unwrap();
        assert!(refused.contains("its actions have 3 values, those of swm/Toy-v0 1"), "{refused}");
        let mut own = Rows::new(&[400.0; 300], 1, 5);
        own.info.runs = Arc::new([]);
        assert_eq!(own.refusal(), None, "only other programs' rows are looked at");
    }
}
